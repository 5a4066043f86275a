// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "socket_bench.hpp"

int main(int argc, char** argv) {
  try {
    regista::bench::run(regista::bench::Options{argc, argv});
  } catch (const std::exception& exception) {
    std::fprintf(stderr, "%s: %s\n", argv[0], exception.what());
    return EXIT_FAILURE;
  }
}
