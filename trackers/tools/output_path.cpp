#include "output_path.hpp"

namespace asterism::tools {

namespace fs = std::filesystem;

fs::path written_file(const fs::path& path) {
  std::error_code error;
  fs::path at = fs::absolute(path, error);
  constexpr int kMostLinks = 40;  // the limit of Linux
  for (int i = 0; i < kMostLinks && fs::is_symlink(at, error); ++i)
    at = at.parent_path() / fs::read_symlink(at, error);  // an absolute target replaces the path
  const fs::path file = fs::weakly_canonical(at, error);
  return error ? at : file;
}

bool same_file(const fs::path& a, const fs::path& b) {
  std::error_code error;
  if (a.empty() || b.empty() || fs::is_other(a, error)) return false;  // e.g. /dev/null: can be shared
  return fs::equivalent(a, b, error) || written_file(a) == written_file(b);
}

}  // namespace asterism::tools
