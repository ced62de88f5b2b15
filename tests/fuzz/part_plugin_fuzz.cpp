// Fuzzes the names of part models and the files of the plugins in them: the outcome must be a part, a
// std::invalid_argument or, if the plugin cannot be loaded, a std::runtime_error. An input is a name, a line
// feed, and the file.

#include <asterism/parts/concept/part_plugin.hpp>
#include <asterism/parts/concept/part_registry.hpp>
#include <stdexcept>
#include <string>

#include "bytes.hpp"

using namespace asterism;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFolder folder("part_plugin");
  const std::string_view input = fuzz::text(data, size);
  const std::size_t end = input.find('\n');
  std::string name(input.substr(0, end));
  // Skip names of other files on this system, and damaged plugins for this program, which would reach the
  // dynamic linker: it need not survive them.
  const bool is_ours = input.find(ASTERISM_PART_PLUGIN_ABI) != std::string_view::npos;
  if (name.find('/') != std::string::npos || is_ours) return 0;
  if (name.find(':') < name.find('{')) name = folder.path().string() + '/' + name;
  if (end != std::string_view::npos) folder.write("plugin.so", input.substr(end + 1));
  PartRegistry registry;
  const std::size_t known = registry.names().size();
  try {
    AnyPart part = registry.make(name);
  } catch (const std::invalid_argument&) {
  } catch (const std::runtime_error&) {
  }
  if (registry.names().size() != known) std::abort();
  return 0;
}
