#pragma once

#include <filesystem>

namespace asterism::tools {

/// The file that is made or changed where `path` is opened for writing: links are followed, also one to a
/// file that does not exist yet.
std::filesystem::path written_file(const std::filesystem::path& path);

/// Whether what is written to one of the paths would overwrite what is written to, or read from, the other;
/// they need not exist. Hard links are one file, too.
bool same_file(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace asterism::tools
