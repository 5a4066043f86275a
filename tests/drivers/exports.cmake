# SPDX-License-Identifier: Apache-2.0
# A plugin gives one symbol away and wants none of ours: it loads into any program.
execute_process(COMMAND ${NM} -D --defined-only --format=posix ${PLUGIN} OUTPUT_VARIABLE given COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${NM} -DC --undefined-only ${PLUGIN} OUTPUT_VARIABLE wanted COMMAND_ERROR_IS_FATAL ANY)
if(NOT given MATCHES "^regista_plugin [^\n]*\n$")
  message(FATAL_ERROR "exports more or less than regista_plugin:\n${given}")
endif()
if(wanted MATCHES "regista")
  message(FATAL_ERROR "wants symbols of regista:\n${wanted}")
endif()
