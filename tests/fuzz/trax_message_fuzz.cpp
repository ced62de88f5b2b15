// Fuzzes lines of the TraX protocol: what is read as a message must survive formatting and parsing; every
// error must be a TraxError.

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <region.hpp>
#include <string_view>
#include <trax_image.hpp>
#include <trax_message.hpp>

using namespace asterism::tools;

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  try {
    const TraxMessage message = parse_trax_message({reinterpret_cast<const char*>(data), size});
    if (parse_trax_message(format_trax_message(message)) != message) std::abort();
    for (const auto& argument : message.arguments) {
      if (const auto region = parse_region(argument); region && parse_region(to_string(*region)) != region) {
        std::abort();
      }
      // Images in files are not tested here.
      if (argument.starts_with("image:")) decode_trax_image(argument);
    }
    for (const auto& [key, value] : message.properties) split_trax_list(value);
  } catch (const TraxError&) {
    return 0;
  }
  return 0;
}
