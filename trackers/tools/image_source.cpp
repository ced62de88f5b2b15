#include "image_source.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio/registry.hpp>
#include <stdexcept>
#include <utility>

namespace asterism::tools {
namespace {

namespace fs = std::filesystem;

bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }

bool all_digits(const std::string& text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), is_digit);
}

bool is_image(const fs::path& path) {
  static constexpr std::array kExtensions = {".jpg",  ".jpeg", ".png", ".bmp", ".tif", ".tiff",
                                             ".webp", ".ppm",  ".pgm", ".pnm", ".jp2"};
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
}

// Files of a folder in natural order; hidden ones are left out (macOS puts "._x.jpg" beside x.jpg).
template <class Predicate>
std::vector<fs::path> files_of(const fs::path& folder, Predicate wanted) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    if (it->path().filename().string().front() != '.' && it->is_regular_file(error) && wanted(it->path()))
      files.push_back(it->path());
  }
  if (error) throw std::runtime_error("cannot read folder " + folder.string() + ": " + error.message());
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.filename().string(), b.filename().string());
  });
  return files;
}

fs::path folder_of(const fs::path& pattern) {
  fs::path folder = pattern.has_parent_path() ? pattern.parent_path() : fs::path(".");
  if (!fs::is_directory(folder)) throw std::runtime_error("no folder " + folder.string());
  return folder;
}

// Whether a file is named by a printf pattern with one %d, e.g. img_%05d.jpg.
std::function<bool(const fs::path&)> numbered(const fs::path& pattern) {
  const std::string name = pattern.filename().string();
  const size_t percent = name.find('%');
  const size_t letter = name.find_first_not_of("0123456789", percent == std::string::npos ? 0 : percent + 1);
  if (percent == std::string::npos || letter == std::string::npos || name[letter] != 'd' ||
      name.find('%', letter) != std::string::npos) {
    throw std::runtime_error("the pattern " + name + " needs exactly one number such as %d or %05d");
  }
  const std::string before = name.substr(0, percent), after = name.substr(letter + 1);
  const std::string format = name.substr(percent + 1, letter - percent - 1);
  const bool zeros = !format.empty() && format.front() == '0';
  size_t width = 1;
  std::from_chars(format.data(), format.data() + format.size(), width);

  // printf writes more digits than the width where the number needs them, but pads with zeros up to it only.
  return [=](const fs::path& file) {
    const std::string candidate = file.filename().string();
    if (candidate.size() <= before.size() + after.size() || !candidate.starts_with(before) ||
        !candidate.ends_with(after)) {
      return false;
    }
    const std::string digits =
        candidate.substr(before.size(), candidate.size() - before.size() - after.size());
    if (!all_digits(digits)) return false;
    const bool padded = digits.size() > 1 && digits.front() == '0';
    return zeros ? digits.size() == width || (digits.size() > width && !padded) : !padded;
  };
}

// `*` and `?` as a shell has them. Where letters do not fit, the last `*` takes one more: what an earlier one
// takes need never change, so the time is at most the product of both lengths.
bool matches(std::string_view text, std::string_view pattern) {
  constexpr size_t kNone = std::string_view::npos;
  size_t star = kNone, after_star = 0, p = 0;  // of `pattern`; of `text`, where what follows the star begins
  for (size_t t = 0; t < text.size();) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      after_star = t;
    } else if (p < pattern.size() && (pattern[p] == '?' || pattern[p] == text[t])) {
      ++p, ++t;
    } else if (star != kNone) {
      p = star + 1;
      t = ++after_star;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', p) == kNone;
}

}  // namespace

bool natural_less(const std::string& a, const std::string& b) {
  const auto number_at = [](const std::string& s, size_t& at) {
    const size_t start = at;
    while (at < s.size() && is_digit(s[at])) ++at;
    const size_t significant = std::min(s.find_first_not_of('0', start), at);
    return std::pair(at - significant, std::string_view(s).substr(significant, at - significant));
  };
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const auto x = number_at(a, i), y = number_at(b, j);
      if (x != y) return x < y;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i, ++j;
    }
  }
  if (a.size() - i != b.size() - j) return a.size() - i < b.size() - j;
  return a < b;  // 01 and 1: any order, as long as it is one
}

ImageSource ImageSource::open(const std::string& input) {
  ImageSource source;
  const fs::path path(input);
  std::error_code error;
  if (fs::is_directory(path, error)) {
    if (fs::exists(path / "groundtruth.txt")) source.ground_truth_ = path / "groundtruth.txt";
    const bool colour =
        fs::is_directory(path / "color") && (source.ground_truth_ || files_of(path, is_image).empty());
    source.use_folder(colour ? path / "color" : path, is_image, input);
  } else if (fs::exists(path, error)) {
    // OpenCV would take the name of one image for a pattern and read all its neighbours.
    if (is_image(path)) {
      source.use_images({path}, input);
    } else {
      source.use_video(input);
    }
  } else if (all_digits(input) || input.find("://") != std::string::npos) {
    source.use_video(input);
  } else if (input.find('%') != std::string::npos) {
    source.use_folder(folder_of(path), numbered(path), input);
  } else if (input.find_first_of("*?") != std::string::npos) {
    const auto matching = [pattern = path.filename().string()](const fs::path& file) {
      return matches(file.filename().string(), pattern);
    };
    source.use_folder(folder_of(path), matching, input);
  } else {
    throw std::runtime_error("no such file or folder: " + input);
  }
  return source;
}

void ImageSource::use_images(std::vector<fs::path> images, const std::string& input) {
  if (images.empty()) throw std::runtime_error("no images in " + input);
  images_ = std::move(images);
  frame_count_ = static_cast<int>(images_.size());
}

void ImageSource::use_folder(const fs::path& folder, IsFrame is_frame, const std::string& input) {
  use_images(files_of(folder, is_frame), input);
  folder_ = folder;
  is_frame_ = std::move(is_frame);
}

void ImageSource::use_video(const std::string& input) {
  video_file_ = input.starts_with("file:") ? input.substr(5) : input;
  try {
    int camera = 0;
    const auto [end, error] = std::from_chars(input.data(), input.data() + input.size(), camera);
    if (all_digits(input) && error == std::errc{} && !fs::exists(input)) {
      video_.open(camera);
    } else {
      // The other back ends take seconds to refuse what is no video, and start camera drivers for it.
      const bool ffmpeg = cv::videoio_registry::hasBackend(cv::CAP_FFMPEG) && fs::exists(input);
      video_.open(input, ffmpeg ? cv::CAP_FFMPEG : cv::CAP_ANY);
    }
  } catch (const cv::Exception&) {
    video_.release();  // a back end that is not there: the same to the user as one that refuses
  }
  if (!video_.isOpened()) throw std::runtime_error("cannot open " + input + " as a video, camera or image");
  const double fps = video_.get(cv::CAP_PROP_FPS);
  if (fps >= 1 && fps <= 1000) fps_ = fps;
  const double count = video_.get(cv::CAP_PROP_FRAME_COUNT);
  if (count >= 1 && count < 1e9) frame_count_ = static_cast<int>(count);
}

bool ImageSource::reads(const fs::path& path) const {
  std::error_code error;
  // Of files, so that links are seen through; false where one of them does not exist.
  const auto is = [&](const fs::path& other) { return fs::equivalent(path, other, error); };
  if (is(video_file_) || (ground_truth_ && is(*ground_truth_))) return true;
  if (fs::exists(path, error) && std::any_of(images_.begin(), images_.end(), is)) return true;
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  return is_frame_ && is_frame_(path) && fs::equivalent(folder, folder_, error);
}

bool ImageSource::next(cv::Mat& image) {
  if (images_.empty()) {
    if (!video_.read(image) || image.empty()) return false;
    ++position_;
    return true;
  }
  if (position_ == frame_count_) return false;
  const std::string file = images_[static_cast<size_t>(position_)].string();
  cv::Mat decoded;
  std::string reason;
  try {
    decoded = cv::imread(file, cv::IMREAD_COLOR);
  } catch (const cv::Exception& e) {
    reason = ": " + e.err;
  }
  if (decoded.empty()) {
    throw std::runtime_error("cannot decode frame " + std::to_string(position_ + 1) + ", " + file + reason);
  }
  ++position_;
  image = decoded;
  return true;
}

bool ImageSource::skip(int count) {
  for (; count > 0; --count, ++position_) {
    if (images_.empty() ? !video_.grab() : position_ == frame_count_) return false;
  }
  return true;
}

}  // namespace asterism::tools
