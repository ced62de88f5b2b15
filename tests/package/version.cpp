// The macros of <asterism/solver/base/config.hpp> against project(VERSION), given as VERSION.
#include <asterism/solver/base/config.hpp>
#include <iostream>
#include <string>

#define TEXT_IMPL(x) #x
#define TEXT(x) TEXT_IMPL(x)

int main() {
  const std::string numbers =
      TEXT(ASTERISM_VERSION_MAJOR) "." TEXT(ASTERISM_VERSION_MINOR) "." TEXT(ASTERISM_VERSION_PATCH);
  const std::string abi = TEXT(ASTERISM_ABI);
  const std::string abi_start = "v" TEXT(ASTERISM_VERSION_MAJOR) "_" TEXT(ASTERISM_VERSION_MINOR) "_align";
  std::cout << numbers << " " << abi << "\n";
  return numbers == VERSION && abi.starts_with(abi_start) ? 0 : 1;
}
