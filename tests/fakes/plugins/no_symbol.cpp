// SPDX-License-Identifier: Apache-2.0

// A shared library that is no plugin.
extern "C" const int something_else = 1;
