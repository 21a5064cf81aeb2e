/* In an exported unit this says FMI2_FUNCTION_PREFIX, for who links the sources of several units
 * into one program. */
