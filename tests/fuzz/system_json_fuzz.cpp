// Fuzzes systems in JSON: what is read must be valid for a solver and unchanged when written and read again;
// every error must be a std::runtime_error.

#include <asterism/solver/io/json.hpp>
#include <cstdlib>
#include <sstream>
#include <stdexcept>

#include "bytes.hpp"

using namespace asterism;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::vector<AnyStoredSystem> systems;
  try {
    systems = parse_systems(fuzz::text(data, size));
  } catch (const std::runtime_error&) {
    return 0;
  }
  const auto write = [](const std::vector<AnyStoredSystem>& all) {
    std::ostringstream out;
    for (const AnyStoredSystem& any : all)
      std::visit([&](const auto& stored) { write_system(out, stored); }, any);
    return out.str();
  };
  const std::string written = write(systems);
  if (write(parse_systems(written)) != written) std::abort();
  return 0;
}
