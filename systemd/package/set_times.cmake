# Gives every file that is packed, and the archives of the package, the date of the package. CPack reads this file
# after it has installed everything.
execute_process(COMMAND find ${CPACK_TEMPORARY_INSTALL_DIRECTORY} -exec touch --no-dereference --date=${CPACK_SERVOTWIN_DATE} {} +
  COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND date --utc --date=${CPACK_SERVOTWIN_DATE} +%s OUTPUT_VARIABLE seconds OUTPUT_STRIP_TRAILING_WHITESPACE
  COMMAND_ERROR_IS_FATAL ANY)
set(ENV{SOURCE_DATE_EPOCH} ${seconds})
