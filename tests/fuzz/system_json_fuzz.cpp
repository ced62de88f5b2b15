// Fuzzes systems in JSON, of springs and of terms: what is read must be valid for a solver and unchanged when
// written and read again; every error must be a std::runtime_error.

#include <asterism/solver/io/json.hpp>
#include <cstdlib>
#include <sstream>
#include <stdexcept>

#include "bytes.hpp"

using namespace asterism;

namespace {

template <typename Parse, typename Write>
void round_trip(std::string_view text, Parse&& parse, Write&& write) {
  decltype(parse(text)) systems;
  try {
    systems = parse(text);
  } catch (const std::runtime_error&) {
    return;
  }
  const auto written_of = [&write](const auto& all) {
    std::ostringstream out;
    for (const auto& stored : all) write(out, stored);
    return out.str();
  };
  const std::string written = written_of(systems);
  if (written_of(parse(written)) != written) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text = fuzz::text(data, size);
  round_trip(
      text, [](std::string_view from) { return parse_systems(from); },
      [](std::ostream& out, const AnyStoredSystem& any) {
        std::visit([&](const auto& stored) { write_system(out, stored); }, any);
      });
  round_trip(
      text, [](std::string_view from) { return parse_stored_terms(from); },
      [](std::ostream& out, const StoredTerms& stored) {
        if (!validate(stored.system, stored.start, false).empty()) std::abort();
        static_cast<void>(energy(stored.system, stored.start));
        write_stored_terms(out, stored);
      });
  return 0;
}
