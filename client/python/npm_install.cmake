# SPDX-License-Identifier: Apache-2.0
# npm install in this folder; what to do when it cannot.
execute_process(COMMAND ${NPM} install --include=dev --no-audit --no-fund --loglevel error RESULT_VARIABLE failed)
if(failed)
  message(
    FATAL_ERROR
      "npm could not load what the page of `regista teleop` is built with. Behind a proxy: set HTTPS_PROXY, or "
      "`npm config set proxy`, and build again. Without the page: "
      "pip install --config-settings=cmake.define.REGISTA_PAGE=OFF '.[teleop]'")
endif()
