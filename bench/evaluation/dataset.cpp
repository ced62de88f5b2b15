#include "dataset.hpp"

#include <algorithm>
#include <asterism/solver/base/edit_distance.hpp>
#include <asterism/solver/run/any_solver.hpp>
#include <cstdio>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <stdexcept>
#include <utility>

#include "ground_truth.hpp"
#include "layouts.hpp"
#include "text.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

constexpr int kDepth = 4;          // nested folders: DATA/GOT-10k/val/GOT-10k_Val_000001
constexpr std::size_t kNamed = 6;  // entries named, at most, of those that are not used

// "a, b and 3 others".
std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < std::min(names.size(), kNamed); ++i) text += (i > 0 ? ", " : "") + names[i];
  if (names.size() > kNamed) text += " and " + std::to_string(names.size() - kNamed) + " others";
  return text;
}

// A sequence, or several on one video.
struct Found {
  fs::path path;
  const LayoutReader* reader;
};

// Finds the sequences, and notes the other entries of their folders.
class Search {
 public:
  explicit Search(Layout wanted) : wanted_(wanted) {}

  // Whether a path is a sequence or holds some. It lies in `depth` folders below the start.
  bool look(const fs::path& path, int depth) try {
    if (const LayoutReader* reader = reader_of(path)) {
      found.push_back({path, reader});
      return true;
    }
    if (!fs::is_directory(path) || depth == kDepth) return false;
    if (fs::exists(path / "list.txt")) return look_up(path / "list.txt");
    std::vector<fs::path> others;
    const std::size_t before = found.size();
    for (const fs::path& entry : entries_of(path))
      if (!look(entry, depth + 1)) others.push_back(entry);
    if (found.size() > before || depth == 0) tell(path, others, before);
    return found.size() > before;
  } catch (const std::runtime_error& error) {  // a folder or list that cannot be read
    notes.push_back(std::string(error.what()) + ": left out");
    return false;
  }

  std::vector<Found> found;
  std::vector<std::string> notes;

 private:
  const LayoutReader* reader_of(const fs::path& path) const {
    for (const LayoutReader& reader : layout_readers())
      if (wanted_ == Layout::Auto ? reader.recognises(path)
                                  : reader.layout == wanted_ && reader.accepts(path))
        return &reader;
    return nullptr;
  }

  // Finds the sequences that a list names, in its order.
  bool look_up(const fs::path& list) {
    const std::size_t before = found.size();
    const std::vector<std::string> lines = tools::read_lines(list);
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const std::size_t end = lines[i].find_last_not_of(" \t/");
      const std::size_t begin = lines[i].find_first_not_of(" \t");
      if (end == std::string::npos || begin > end) continue;
      const std::string name = lines[i].substr(begin, end + 1 - begin);
      if (!look((list.parent_path() / name).lexically_normal(), kDepth))
        notes.push_back(list.string() + ":" + std::to_string(i + 1) + ": no sequence \"" + name +
                        "\" in a known layout: left out");
    }
    return found.size() > before;
  }

  // Notes the entries of a folder that are not used, apart from files of its sequences, found[first] and on.
  void tell(const fs::path& folder, const std::vector<fs::path>& others, std::size_t first) {
    std::set<fs::path> box_files;
    for (std::size_t i = first; i < found.size(); ++i) box_files.insert(box_file(found[i].path));
    std::vector<std::string> names;
    for (const fs::path& entry : others) {
      if (box_files.contains(entry) || (name_of(entry) == "anno" && found.size() > first)) continue;
      if (is_video(entry))
        notes.push_back(entry.string() + ": a video without " + name_of(box_file(entry)) +
                        " beside it, a box a frame or the first alone: left out");
      else
        names.push_back(name_of(entry));
    }
    if (!names.empty())
      notes.push_back(folder.string() + ": left out, as no sequence in a known layout: " + listed(names));
  }

  Layout wanted_;
};

// Why a name cannot be a sequence's, since folders and files are named after it; empty if it can.
std::string reason_against(const std::string& name) {
  if (name.empty() || name == "." || name == "..") return "it has no name of its own: name its folder";
  if (!is_utf8(name)) return "the name is not UTF-8, as reports need it: rename it";
  return {};
}

}  // namespace

std::string_view to_string(Layout layout) {
  for (const LayoutReader& reader : layout_readers())
    if (reader.layout == layout) return reader.name;
  return "auto";
}

std::string layout_names() {
  std::string names(to_string(Layout::Auto));
  for (const LayoutReader& reader : layout_readers()) names += ", " + std::string(reader.name);
  return names;
}

Layout parse_layout(const std::string& name) {
  if (name == to_string(Layout::Auto)) return Layout::Auto;
  for (const LayoutReader& reader : layout_readers())
    if (reader.name == name) return reader.layout;
  throw std::invalid_argument("unknown layout \"" + name + "\" (known: " + layout_names() + ")");
}

Dataset open_dataset(const fs::path& path, Layout layout, const std::vector<std::string>& only) {
  if (!fs::exists(path)) fail(path, "no such file or folder");
  // A trailing separator would hide the folder's name.
  const fs::path root = fs::absolute(path.has_filename() ? path : path.parent_path()).lexically_normal();
  Search search(layout);
  search.look(root.has_filename() ? root : root.parent_path(), 0);
  const auto is_of = [](Layout wanted) {
    return [wanted](const Found& f) { return f.reader->layout == wanted; };
  };
  Dataset dataset;
  if (only.empty()) dataset.notes = std::move(search.notes);
  if (std::any_of(search.found.begin(), search.found.end(), is_of(Layout::Nfs)) &&
      std::erase_if(search.found, is_of(Layout::Nfs240)) > 0)
    dataset.notes.push_back(path.string() +
                            ": the videos at 240 frames a second are left out: --layout nfs240 takes them");

  std::map<std::string, fs::path> names;
  std::string first_reason;  // why the first unreadable sequence cannot be read
  for (const Found& f : search.found) {
    // Sequences not asked for are not read, so that their defects do not matter. A sequence's name begins
    // with that of its file.
    const std::string begin = f.path.stem().string();
    if (!only.empty() &&
        std::none_of(only.begin(), only.end(), [&](const std::string& n) { return n.starts_with(begin); })) {
      continue;
    }
    try {
      for (Sequence& sequence : f.reader->read(f.path, dataset.notes)) {
        if (!only.empty() && std::find(only.begin(), only.end(), sequence.name) == only.end()) continue;
        if (const std::string reason = reason_against(sequence.name); !reason.empty()) fail(f.path, reason);
        const auto [other, added] = names.emplace(sequence.name, f.path);
        if (!added) fail(f.path, "another sequence of that name is " + other->second.string());
        sequence.from_one = f.reader->from_one;
        dataset.sequences.push_back(std::move(sequence));
      }
    } catch (const std::exception& error) {
      if (first_reason.empty()) first_reason = error.what();
      dataset.notes.push_back(std::string(error.what()) + ": the sequence is left out");
    }
  }
  const auto is_missing = [&](const std::string& name) { return !names.contains(name); };
  const auto missing = std::find_if(only.begin(), only.end(), is_missing);
  if (!first_reason.empty() && (dataset.sequences.empty() || missing != only.end()))
    throw std::runtime_error(first_reason);
  if (missing != only.end()) {
    std::vector<std::string> known;
    for (const Found& f : search.found) known.push_back(f.path.stem().string());
    fail(path, "no sequence '" + *missing + "'" +
                   detail::near_name(detail::letters_of(*missing), known, detail::letters_of));
  }
  if (dataset.sequences.empty())
    fail(path, "no annotated sequence, such as a folder with images and groundtruth.txt" +
                   (dataset.notes.empty() ? std::string() : " (" + dataset.notes.front() + ")"));
  for (std::string& note : dataset.notes) note = printable(note);
  return dataset;
}

void print_notes(const Dataset& dataset) {
  for (const std::string& note : dataset.notes) std::fprintf(stderr, "%s\n", note.c_str());
}

cv::Mat compressed(const cv::Mat& image, int quality) {
  std::vector<unsigned char> bytes;
  cv::imencode(".jpg", image, bytes, {cv::IMWRITE_JPEG_QUALITY, quality});
  return cv::imdecode(bytes, cv::IMREAD_UNCHANGED);
}

cv::Mat FrameReader::operator()(std::size_t t) try {
  return sequence_.jpeg > 0 ? compressed(read(t), sequence_.jpeg) : read(t);
} catch (const std::runtime_error& error) {
  throw UnreadableSequence(error.what());
}

cv::Mat FrameReader::read(std::size_t t) {
  if (t >= sequence_.length())
    throw std::out_of_range(sequence_.name + " has no frame " + std::to_string(t + 1));
  cv::Mat image;
  if (!sequence_.images.empty()) {
    const fs::path& file = sequence_.images[t];
    const tools::FrameImage frame = tools::read_frame(file, sequence_.range);
    if (frame.damaged) fail(file, "a damaged image: fetch it again");
    try {
      if (!std::exchange(checked_, true)) first_frame(frame.pixels);
      return tools::to_bgr8(frame.pixels);
    } catch (const std::invalid_argument& error) {
      fail(file, error.what());
    }
  }
  if (!video_ || static_cast<std::size_t>(video_->position()) > t)
    video_ = tools::ImageSource::open(sequence_.video.string(), {.range = sequence_.range});
  if (!video_->skip(static_cast<int>(t) - video_->position()) || !video_->next(image))
    fail(sequence_.video, "frame " + std::to_string(t + 1) + " cannot be decoded");
  return image.clone();  // the decoder reuses its image
}

}  // namespace asterism::bench
