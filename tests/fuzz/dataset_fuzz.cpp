// Fuzzes the reading of folders that look like data sets. In the input, a line "@NAME" begins the file of
// that name. Sequences that are found must have a truth and a tag for each frame; every error must be a
// std::runtime_error.

#include <cstdlib>
#include <dataset.hpp>
#include <stdexcept>

#include "bytes.hpp"

using namespace asterism;
namespace fs = std::filesystem;

namespace {

// Whether the name is within the folder.
bool is_ours(const fs::path& name) {
  if (name.empty() || name.is_absolute() || name.native().size() > 100 || !name.has_filename()) return false;
  for (const fs::path& part : name)
    if (part == ".." || part == ".") return false;
  return name.native().find('\0') == std::string::npos;
}

bool build(const fuzz::ScratchFolder& folder, std::string_view input) {
  constexpr int kMost = 24;
  int files = 0;
  while (!input.empty()) {
    if (input.front() != '@' || ++files > kMost) return false;
    input.remove_prefix(1);
    const fs::path name(input.substr(0, input.find('\n')));
    input.remove_prefix(std::min(input.size(), name.native().size() + 1));
    const std::string_view content = input.substr(0, input.find("\n@"));
    input.remove_prefix(std::min(input.size(), content.size() + 1));
    if (!is_ours(name)) return false;
    std::error_code error;
    fs::create_directories((folder.path() / name).parent_path(), error);
    if (!error) folder.write(name, content);
  }
  return files > 0;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFolder folder("dataset");
  const std::string_view input = fuzz::text(data, size);
  // "sequence" and list.txt may name files anywhere, and devices never end.
  if (input.find("dev") != std::string_view::npos || input.find("proc") != std::string_view::npos) return 0;
  folder.clear();
  if (!build(folder, input)) return 0;
  for (const char* layout :
       {"auto", "vot", "otb", "got10k", "lasot", "tc128", "trackingnet", "uav123", "nfs", "nfs240", "plain"})
    try {
      const bench::Dataset dataset = bench::open_dataset(folder.path(), bench::parse_layout(layout));
      for (const bench::Sequence& sequence : dataset.sequences) {
        const std::size_t length = sequence.length();
        if (length == 0 || sequence.name.empty()) std::abort();
        if (sequence.video.empty() && sequence.images.size() != length) std::abort();
        if (!sequence.practical.empty() && sequence.practical.size() != length) std::abort();
        for (const auto& [name, values] : sequence.tags)
          if (values.size() != length) std::abort();
      }
    } catch (const std::runtime_error&) {
    }
  return 0;
}
