#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "dataset.hpp"

namespace asterism::bench {

/// How the sequences of one layout are recognised and read. A new layout is a new row of kReaders.
struct LayoutReader {
  Layout layout;
  std::string_view name;
  /// Whether a folder or file is a sequence (or several, on one video) of this layout, as far as it differs
  /// from the others.
  bool (*recognises)(const std::filesystem::path& path);
  /// Whether it can be read as this layout if the user asks for it.
  bool (*accepts)(const std::filesystem::path& path);
  /// Throws std::runtime_error, which names the file and says what to do. Corrections are described in
  /// `notes`, a line each.
  std::vector<Sequence> (*read)(const std::filesystem::path& path, std::vector<std::string>& notes);
  /// Whether its boxes count pixels from 1.
  bool from_one = false;
};

/// All layouts; of two that recognise a folder, the first is taken.
std::span<const LayoutReader> layout_readers();

/// Whether a file's name ends as a video's does, in small or capital letters.
bool is_video(const std::filesystem::path& path);
/// The box file beside a video or a folder of images: NAME.txt.
std::filesystem::path box_file(const std::filesystem::path& path);
/// The last part of a path.
std::string name_of(const std::filesystem::path& path);
/// Entries of a folder in natural order without the hidden ones.
std::vector<std::filesystem::path> entries_of(const std::filesystem::path& folder);

}  // namespace asterism::bench
