/* In an exported unit this file defines FMI2_FUNCTION_PREFIX, so that the sources of several units
 * can be linked into one program. */
