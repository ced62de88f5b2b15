#pragma once

#include <filesystem>
#include <map>
#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>
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
  std::vector<std::filesystem::path> images;  ///< one per frame; empty if the frames are those of `video`
  std::filesystem::path video;
  std::vector<std::optional<Region>> truth;  ///< per frame [px, as published]; empty: no object, or unknown
  std::map<std::string, std::vector<bool>> tags;  ///< attributes by name, one value per frame
  std::optional<PixelRange> range = {};           ///< of the images' pixels; none: as Frame assumes
  int jpeg = 0;  ///< quality at which the images are compressed again; 0: they stay as they are
  std::vector<double> practical;  ///< VOT's practical difference of overlaps, per frame; empty without it
  bool from_one = false;          ///< `truth` counts pixels from 1, as OTB does, not from 0

  std::size_t length() const { return truth.size(); }
};

/// How a data set is stored. Boxes are as published: those of OTB, Temple-Color-128, LaSOT and UAV123 count
/// pixels from 1, the others from 0. A single box is that of the first frame; the other frames are unknown.
enum class Layout {
  Auto,  ///< the first in layout_readers() that recognises it
  Vot,   ///< SEQ/groundtruth.txt, color/00000001.jpg (or as SEQ/sequence says, or beside it), *.tag, *.label,
         ///< practical.value. Frames beyond the last region are unknown.
  Otb,   ///< SEQ/groundtruth_rect.txt or, with several objects, groundtruth_rect.1.txt, .2.txt: SEQ-1, SEQ-2;
         ///< img/, of which sequences that begin late or end early use the published part. The attributes of
         ///< the published sequences are tags of all their frames.
  Got10k,       ///< SEQ/groundtruth.txt, 00000001.jpg, absence.label, cover.label, cut_by_image.label,
                ///< meta_info.ini. No object in frames where it is absent or entirely hidden; the tag
                ///< "occlusion" where it is not fully visible.
  Lasot,        ///< SEQ/groundtruth.txt, img/, full_occlusion.txt, out_of_view.txt, absent.txt. No object in
                ///< frames that one of these files flags.
  Tc128,        ///< Temple-Color-128: SEQ/SEQ_gt.txt, img/, of which SEQ_frames.txt names the first and last
  TrackingNet,  ///< frames/SEQ/0.jpg, anno/SEQ.txt
  Uav123,       ///< data_seq/UAV123/VIDEO/000001.jpg, anno/UAV123/SEQ.txt: whole videos and the published
                ///< parts of them; the same for UAV123_10fps
  Nfs,          ///< SEQ/30/SEQ/00001.jpg, SEQ/30/SEQ.txt in VATIC's format, one or eight lines per frame
  Nfs240,       ///< SEQ/240/SEQ/00001.jpg, SEQ/240/SEQ.txt; Auto takes Nfs if both are there
  Plain         ///< a folder of images or a video and, beside it, NAME.txt with one box per frame or only the
                ///< first box
};

/// "auto", "vot", "otb", "got10k", "lasot", "tc128", "trackingnet", "uav123", "nfs", "nfs240", "plain".
std::string_view to_string(Layout layout);
/// The layout of that name; std::invalid_argument, which lists the names, for any other.
Layout parse_layout(const std::string& name);
/// All names, separated by commas.
std::string layout_names();

struct Dataset {
  std::vector<Sequence> sequences;
  /// What was corrected, left out or not used, one line each, for the user to read.
  std::vector<std::string> notes;
};

/// The sequences of `path`: one sequence, or a folder of them (in the order of list.txt if there is one, else
/// of their names; also in nested folders, like LaSOT's classes). Only those named in `only` unless that is
/// empty. A sequence that cannot be read is left out with a note that names file and line: gaps in the
/// numbers of images, counts of images and boxes that differ, malformed lines, a name that is used twice or
/// is not UTF-8. Throws std::runtime_error if no sequence is left, and if one of `only` is not there or
/// cannot be read.
Dataset open_dataset(const std::filesystem::path& path, Layout layout = Layout::Auto,
                     const std::vector<std::string>& only = {});

/// Prints the notes on standard error.
void print_notes(const Dataset& dataset);

/// The image after JPEG of this quality.
cv::Mat compressed(const cv::Mat& image, int quality);

/// A frame of a sequence cannot be read. The message names the file and the reason.
class UnreadableSequence : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The frames of a sequence in any order (for an earlier frame, a video is decoded from its beginning).
class FrameReader {
 public:
  /// `sequence` must outlive the reader.
  explicit FrameReader(const Sequence& sequence) : sequence_(sequence) {}

  /// Frame t, from 0; 8-bit BGR. Throws UnreadableSequence if the image is damaged or cannot be a frame (see
  /// tools::read_frame), and if the first image that is read would be black in 8 bits (see first_frame): a
  /// score on other frames than the published ones would say nothing.
  cv::Mat operator()(std::size_t t);

 private:
  cv::Mat read(std::size_t t);

  const Sequence& sequence_;
  std::optional<tools::ImageSource> video_;
  bool checked_ = false;  // whether the first image that was read is not black
};

}  // namespace asterism::bench
