#pragma once

#include <filesystem>
#include <map>
#include <opencv2/core.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "image_source.hpp"
#include "region.hpp"

namespace asterism::bench {

using tools::Region;

/// One object in one annotated sequence; images stay on the disk (see `FrameReader`).
struct Sequence {
  std::string name;
  std::vector<std::filesystem::path> images;  ///< one a frame; empty where the frames are those of `video`
  std::filesystem::path video;
  std::vector<std::optional<Region>> truth;  ///< one a frame [px, as published]; empty: no object, or unknown
  std::map<std::string, std::vector<bool>> tags;  ///< attributes by name, one value a frame
  std::optional<PixelRange> range = {};           ///< of the images' pixels; without one what Frame assumes
  std::vector<double> practical;  ///< VOT's practical difference of overlaps, one a frame; empty without it

  std::size_t length() const { return truth.size(); }
};

/// How a data set lies on the disk.
enum class Layout {
  Auto,  ///< whichever of the others it looks like
  Vot,   ///< SEQ/groundtruth.txt, color/00000001.jpg (or as SEQ/sequence says, or beside it), *.tag, *.label,
         ///< practical.value
  Otb,   ///< SEQ/groundtruth_rect.txt or, with several objects, groundtruth_rect.1.txt, .2.txt: SEQ-1, SEQ-2;
         ///< img/, of which sequences that begin late or end early use the published part. Boxes are as
         ///< published: their first pixel is 1, not 0. The attributes of the published sequences are tags of
         ///< all their frames.
  Got10k,  ///< SEQ/groundtruth.txt, 00000001.jpg, absence.label, cover.label, cut_by_image.label,
           ///< meta_info.ini. No object where it is absent or not visible at all; the tag "occlusion" where
           ///< it is not fully visible. A single line, as in the test set: the other frames are unknown.
  Lasot,  ///< SEQ/groundtruth.txt, img/, full_occlusion.txt, out_of_view.txt. No object where either says so.
  Plain,  ///< a folder of images or a video and, beside it, NAME.txt with a box a frame or the first box
          ///< alone
};

/// "auto", "vot", "otb", "got10k", "lasot", "plain".
std::string_view to_string(Layout layout);
/// The layout of that name; std::invalid_argument, which lists the names, for any other.
Layout parse_layout(const std::string& name);

/// The sequences of `path`: one sequence, or a folder of them (in the order of list.txt where there is one,
/// else of their names; also in folders of folders, as LaSOT's classes). Only those named in `only` unless
/// that is empty. Throws std::runtime_error that names file and line for gaps in the numbers of images,
/// counts of images, boxes and tags that differ, malformed lines, two sequences of one name, and where there
/// is none.
std::vector<Sequence> open_dataset(const std::filesystem::path& path, Layout layout = Layout::Auto,
                                   const std::vector<std::string>& only = {});

/// The frames of a sequence, one after another or at random (a video begins anew for an earlier frame).
class FrameReader {
 public:
  /// `sequence` must outlive the reader.
  explicit FrameReader(const Sequence& sequence) : sequence_(sequence) {}

  /// Frame t, from 0; 8-bit BGR. A damaged image is a blank frame of the size of another. Throws
  /// std::runtime_error that names the file where it can be no frame at all (see tools::read_frame).
  cv::Mat operator()(std::size_t t);
  /// The images read until now that were damaged.
  const std::set<std::filesystem::path>& damaged() const { return damaged_; }

 private:
  const Sequence& sequence_;
  std::optional<tools::ImageSource> video_;
  std::set<std::filesystem::path> damaged_;
  cv::Size size_;  // of an image that is not damaged
};

}  // namespace asterism::bench
