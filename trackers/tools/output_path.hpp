#pragma once

#include <filesystem>

namespace asterism::tools {

/// The file that opening `path` for writing creates or changes: links are followed, even to a file that does
/// not exist yet.
std::filesystem::path written_file(const std::filesystem::path& path);

/// Whether writing to one path would overwrite the file at the other; neither needs to exist. Hard links
/// count as one file.
bool same_file(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace asterism::tools
