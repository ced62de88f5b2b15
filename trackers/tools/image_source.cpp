#include "image_source.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio/registry.hpp>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "output_path.hpp"

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

bool is_webp(const fs::path& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return false;  // what a pipe gives can be read only once
  std::array<char, 12> begin{};
  std::ifstream(path, std::ios::binary).read(begin.data(), begin.size());
  const std::string_view text(begin.data(), begin.size());
  return text.starts_with("RIFF") && text.ends_with("WEBP");
}

// Files in a folder, in natural order, without hidden ones (macOS puts "._x.jpg" beside x.jpg).
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

// A file's name without its extension and without leading zeros in numbers, to detect two files for one
// frame.
std::string frame_name(const fs::path& file) {
  std::string name;
  for (const char c : file.stem().string()) {
    const bool after_zero = !name.empty() && name.back() == '0' && is_digit(c) &&
                            (name.size() == 1 || !is_digit(name[name.size() - 2]));
    if (after_zero) name.pop_back();
    name += c;
  }
  return name;
}

// The numbers in a name, one after another.
std::string numbers_of(const std::string& name) {
  std::string numbers;
  for (std::size_t i = 0; i < name.size(); ++i) {
    if (is_digit(name[i]))
      numbers += name[i];
    else if (!numbers.empty() && numbers.back() != ' ')
      numbers += ' ';
  }
  while (!numbers.empty() && numbers.back() == ' ') numbers.pop_back();
  return numbers;
}

// A pattern for a file and those that differ from it in their last number.
std::string pattern_of(const fs::path& file) {
  std::string name = file.filename().string();
  const std::size_t end = file.stem().string().find_last_of("0123456789") + 1;
  std::size_t begin = end;
  while (begin > 0 && is_digit(name[begin - 1])) --begin;
  const std::string width = name[begin] == '0' && end - begin > 1 ? "0" + std::to_string(end - begin) : "";
  return name.replace(begin, end - begin, "%" + width + "d");
}

// The last number in an image's name, if nothing else in it differs from the name before.
std::optional<std::int64_t> step_between(const fs::path& before, const fs::path& after) {
  const auto parts = [](const fs::path& file) {
    const std::string name = file.stem().string();
    const std::size_t end = name.find_last_of("0123456789") + 1;
    std::size_t begin = end;
    while (begin > 0 && is_digit(name[begin - 1])) --begin;
    std::int64_t number = -1;
    std::from_chars(name.data() + begin, name.data() + end, number);
    return std::tuple(name.substr(0, begin), name.substr(end), number);
  };
  const auto [head, tail, first] = parts(before);
  const auto [other_head, other_tail, second] = parts(after);
  if (head != other_head || tail != other_tail || first < 0 || second <= first) return {};
  return second - first;
}

// A note if the images' numbers have a gap: a step larger than the median. Empty if they have none.
std::string gap_between(const std::vector<fs::path>& images) {
  std::vector<std::int64_t> steps;
  for (std::size_t i = 1; i < images.size(); ++i)
    if (const auto step = step_between(images[i - 1], images[i])) steps.push_back(*step);
  if (steps.empty()) return {};
  const auto middle = steps.begin() + (std::ssize(steps) - 1) / 2;
  std::nth_element(steps.begin(), middle, steps.end());
  const std::int64_t usual = *middle;
  std::size_t first = 0;
  std::int64_t missing = 0;
  for (std::size_t i = 1; i < images.size(); ++i) {
    const auto step = step_between(images[i - 1], images[i]);
    if (!step || *step <= usual) continue;
    if (first == 0) first = i;
    missing += (*step - 1) / usual;
  }
  if (first == 0) return {};
  return "images are missing: " + std::to_string(missing) + " by their numbers, the first after " +
         images[first - 1].string() + "; frames are counted without them, so that " +
         images[first].filename().string() + " is frame " + std::to_string(first + 1);
}

// Whether one name is the other one with something before or behind it: 1 and 1_mask.
bool extends(const std::string& a, const std::string& b) {
  const auto& [shorter, longer] =
      std::minmax(a, b, [](const auto& x, const auto& y) { return x.size() < y.size(); });
  return longer.starts_with(shorter) || longer.ends_with(shorter);
}

fs::path folder_of(const fs::path& pattern) {
  fs::path folder = pattern.has_parent_path() ? pattern.parent_path() : fs::path(".");
  if (!fs::is_directory(folder)) throw std::runtime_error("no folder " + folder.string());
  return folder;
}

// Tests whether a file's name matches a printf pattern with one %d, e.g. img_%05d.jpg.
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

  // printf exceeds the width if the number has more digits, but pads with zeros only up to it.
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

// Matches `*` and `?` as a shell does. On a mismatch the last `*` takes one more character; earlier ones
// never need to change, so the time is at most the product of both lengths.
bool matches(std::string_view text, std::string_view pattern) {
  constexpr size_t kNone = std::string_view::npos;
  size_t star = kNone, after_star = 0, p = 0;  // star, p: in `pattern`; after_star: in `text`
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
  return a < b;  // 01 and 1: any consistent order
}

ImageSource ImageSource::open(const std::string& input, const FrameOptions& options) {
  ImageSource source;
  source.options_ = options;
  const fs::path path(input);
  std::error_code error;
  if (fs::is_directory(path, error)) {
    if (fs::exists(path / "groundtruth.txt")) source.ground_truth_ = path / "groundtruth.txt";
    const bool color =
        fs::is_directory(path / "color") && (source.ground_truth_ || files_of(path, is_image).empty());
    source.use_folder(color ? path / "color" : path, is_image, input);
  } else if (fs::exists(path, error)) {
    // VideoCapture would take an image's name for a pattern and read all its neighbours. A WebP is an image
    // under any name: FFmpeg opens an animated one and finds no frames.
    if (is_image(path) || is_webp(path)) {
      source.use_image(path, input);
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
  std::map<std::string, fs::path> first;  // image by the numbers in its name, or by its name without numbers
  for (const fs::path& image : images_) {
    const std::string name = frame_name(image), numbers = numbers_of(name);
    const auto [found, added] = first.emplace(numbers.empty() ? name : numbers, image);
    if (added) continue;
    const fs::path& other = found->second;
    const std::string other_name = frame_name(other);
    if (!extends(name, other_name)) continue;
    throw std::runtime_error(
        "two images for one frame in " + folder.string() + ": " + other.filename().string() + " and " +
        image.filename().string() + "; choose by a pattern such as '" +
        (name == other_name ? "*" + image.extension().string()
                            : pattern_of(name.size() < other_name.size() ? image : other)) +
        "'");
  }
  if (std::string gap = gap_between(images_); !gap.empty()) notes_.push_back(std::move(gap));
}

// A single image, or a file with several: a TIFF with pages or an animation.
void ImageSource::use_image(const fs::path& image, const std::string& input) {
  std::vector<unsigned char> bytes = read_bytes(image);
  const std::optional<ImageHeader> header = read_image_header(bytes);
  if (header && header->animated && bytes[0] == 0x89) return use_video(input);  // PNG: FFmpeg plays it
  if (!header || header->pages.size() < 2) return use_images({image}, input);
  stack_ = std::move(bytes);
  pages_ = header->pages;
  file_ = image;
  frame_count_ = static_cast<int>(pages_.size());
}

namespace {

// The highest frame rate accepted from a header that no timestamps confirm; some writers of milliseconds
// leave 1000.
constexpr double kFastest = 240;
bool plausible(double fps) { return fps >= 1 && fps <= kFastest; }

// Clockwise rotation that makes a video's frames upright [degrees].
int rotation_of(const cv::VideoCapture& video) {
  const int angle = static_cast<int>(video.get(cv::CAP_PROP_ORIENTATION_META));
  // OpenCV 4.6.0 reports it counterclockwise and rotates frames the wrong way (its issue 22088).
  const bool counterclockwise =
      cv::getVersionMajor() == 4 && cv::getVersionMinor() == 6 && cv::getVersionRevision() == 0;
  return ((counterclockwise ? -angle : angle) % 360 + 360) % 360;
}

}  // namespace

void ImageSource::use_video(const std::string& input) {
  file_ = input.starts_with("file:") ? input.substr(5) : input;
  int camera = 0;
  const bool is_number = std::from_chars(input.data(), input.data() + input.size(), camera).ec == std::errc{};
  const bool is_camera = all_digits(input) && is_number && !fs::exists(input);
  try {
    if (is_camera) {
      video_.open(camera);
    } else {
      // The other back ends take seconds to refuse a file that is not a video, and start camera drivers for
      // it.
      const bool ffmpeg = cv::videoio_registry::hasBackend(cv::CAP_FFMPEG) && fs::exists(input);
      video_.open(input, ffmpeg ? cv::CAP_FFMPEG : cv::CAP_ANY);
    }
  } catch (const cv::Exception&) {
    video_.release();  // the back end is missing: reported below like one that refuses
  }
  if (!video_.isOpened())
    throw std::runtime_error("cannot open " +
                             (is_camera ? "camera " + input + ": none is there, or another program has it"
                                        : input + " as a video or image"));
  const double width = video_.get(cv::CAP_PROP_FRAME_WIDTH), height = video_.get(cv::CAP_PROP_FRAME_HEIGHT);
  if (width * height > static_cast<double>(kMostPixels))
    throw std::runtime_error(input + ": a video of " + std::to_string(std::lround(width)) + " x " +
                             std::to_string(std::lround(height)) + " pixels, and at most " +
                             std::to_string(kMostPixels) + " are read");
  std::error_code error;
  is_file_ = fs::is_regular_file(file_, error);
  if (video_.set(cv::CAP_PROP_ORIENTATION_AUTO, 0)) rotation_ = rotation_of(video_);
  const double count = video_.get(cv::CAP_PROP_FRAME_COUNT);
  if (count >= 1 && count < 1e9 && plausible(video_.get(cv::CAP_PROP_FPS)))
    frame_count_ = static_cast<int>(count);
}

namespace {

// The time of the frame that was grabbed last [s]. The last frames of a stream with B-frames have none:
// OpenCV 4.6 says 0, so that a time counts only if it is later than that of the frame before.
void append_time(const cv::VideoCapture& video, std::vector<double>& times) {
  const double time = video.get(cv::CAP_PROP_POS_MSEC) / 1000;
  if (times.empty() || time > times.back()) times.push_back(time);
}

// The mean rate; 0 if unknown.
double mean_rate(const std::vector<double>& times) {
  return times.size() < 2 ? 0 : static_cast<double>(times.size() - 1) / (times.back() - times.front());
}

bool agree(double rate, double announced) { return std::abs(rate - announced) <= 0.05 * rate; }

// The rate: that of most frames if it is steady.
double rate_of(const std::vector<double>& times) {
  const std::optional<double> interval = steady_interval(times);
  return interval ? 1 / *interval : mean_rate(times);
}

}  // namespace

// Determines the rate of a video if the timestamps of its first frames contradict its header.
void ImageSource::measure_video() {
  if (std::exchange(measured_, true) || !video_.isOpened()) return;
  const double announced = video_.get(cv::CAP_PROP_FPS),
               seconds = video_.get(cv::CAP_PROP_FRAME_COUNT) / announced;
  const auto take = [&](double fps) {
    fps_ = fps >= 1 && fps <= 1000 ? fps : 25;
    if (fps_ != fps) notes_.emplace_back("the frame rate is unknown, 25 a second are taken: say it by --fps");
  };
  const auto unconfirmed = [&] { take(plausible(announced) ? announced : 0); };
  if (!is_file_) return unconfirmed();

  constexpr int kFirst = 100;
  int first = 0;
  std::vector<double> times;
  cv::VideoCapture video(file_.string());
  for (; first < kFirst && video.grab(); ++first) append_time(video, times);
  const double rate = rate_of(times);
  if (rate == 0) return unconfirmed();
  if (agree(rate, announced)) return take(announced);
  if (first < kFirst) return take(rate);
  const double mean = count_packets(file_) / seconds;
  take(mean > rate / 4 && mean < rate * 4 ? mean : rate);
}

double ImageSource::fps() {
  if (options_.fps > 0) return options_.fps;
  measure_video();
  return fps_;
}

bool ImageSource::ended_early() {
  if (position_ >= frame_count_) return false;
  if (!video_.isOpened() || !is_file_) return true;
  if (const int packets = count_packets(file_); packets > position_) {
    frame_count_ = packets;
    return true;
  }
  const VideoContainer container = read_container(file_);
  if (container.cut || container.counts_offset) return container.cut;
  const double rate = rate_of(times_);
  return rate == 0 || agree(rate, video_.get(cv::CAP_PROP_FPS));
}

bool ImageSource::reads(const fs::path& path) const {
  std::error_code error;
  const auto is = [&](const fs::path& other) { return same_file(path, other); };
  if (is(file_) || (ground_truth_ && is(*ground_truth_))) return true;
  const fs::path written = written_file(path);
  const auto is_one = [&](const fs::path& other) { return fs::equivalent(written, other, error); };
  if (fs::exists(written, error) && std::any_of(images_.begin(), images_.end(), is_one)) return true;
  return is_frame_ && is_frame_(written) && fs::equivalent(written.parent_path(), folder_, error);
}

cv::Mat ImageSource::upright(const cv::Mat& image) const {
  cv::Mat turned;
  switch (options_.rotate.value_or(rotation_)) {
    case 90:
      cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);
      return turned;
    case 180:
      cv::rotate(image, turned, cv::ROTATE_180);
      return turned;
    case 270:
      cv::rotate(image, turned, cv::ROTATE_90_COUNTERCLOCKWISE);
      return turned;
    default:
      return image;
  }
}

// The image or page after `position_`, at the file's depth unless a range is given.
cv::Mat ImageSource::read_image() try {
  const auto index = static_cast<size_t>(position_);
  const fs::path& file = stack_.empty() ? images_[index] : file_;
  if (!stack_.empty()) make_first_page(stack_, pages_[index]);
  const FrameImage frame = stack_.empty() ? read_frame(file, options_.range, size_)
                                          : decode_frame(stack_, file.string(), options_.range, size_, true);
  if (frame.damaged)
    damaged_.push_back("frame " + std::to_string(position_ + 1) + ", " + file.string());
  else
    size_ = frame.pixels.size();
  return frame.pixels;
} catch (const std::runtime_error& e) {
  throw std::runtime_error("cannot decode frame " + std::to_string(position_ + 1) + ", " + e.what());
}

// Converts a deep image by the range that Frame assumes, which the first image is used to check.
cv::Mat ImageSource::in_8_bits(const cv::Mat& image) try {
  if (decoded_) return to_bgr8(image);
  cv::Mat bgr = to_bgr8(image);
  const std::optional<PixelRange> suggested = suggested_range(image);
  if (image.depth() == CV_32F && suggested)
    throw std::invalid_argument("float pixels below 1/256 would be black: give the value that is white");
  if (image.depth() == CV_16U && suggested) {
    const std::string bits = std::to_string(std::lround(std::log2(suggested->white + 1)));
    if (bits == "8")
      throw std::invalid_argument("16 bits a pixel that use 8 and would be black: give --bits 8");
    notes_.push_back("the first frame uses " + bits + " of 16 bits: --bits " + bits +
                     " or --range LOW,HIGH would spread them");
  }
  return bgr;
} catch (const std::invalid_argument& e) {
  throw std::runtime_error("frame " + std::to_string(position_ + 1) + ": " + e.what() +
                           (image.depth() == CV_32F ? " by --range LOW,HIGH" : ""));
}

bool ImageSource::next(cv::Mat& image) {
  cv::Mat read;
  if (video_.isOpened()) {
    if (!video_.read(read) || read.empty()) return false;
    if (is_file_) append_time(video_, times_);
    if (options_.range) read = to_bgr8(read, options_.range);
  } else {
    if (position_ == frame_count_) return false;
    read = read_image();
    if (read.type() != CV_8UC3) read = in_8_bits(read);
  }
  decoded_ = true;
  ++position_;
  image = in_first_size(upright(read));
  return true;
}

// The same scene at another resolution, as an adaptive stream sends it: the object's size does not change.
cv::Mat ImageSource::in_first_size(const cv::Mat& image) {
  const cv::Size size = image.size(),
                 first = std::exchange(first_size_, first_size_.empty() ? size : first_size_);
  const auto product = [](int a, int b) { return std::int64_t{a} * b; };
  const bool same_shape = std::abs(product(size.width, first.height) - product(size.height, first.width)) <=
                          std::max(first.width, first.height);
  if (first.empty() || size == first || !same_shape) return image;
  if (!std::exchange(scaled_, true))
    notes_.push_back("frame " + std::to_string(position_) + " has " + std::to_string(size.width) + " x " +
                     std::to_string(size.height) + " pixels: frames of this shape are scaled to the " +
                     std::to_string(first.width) + " x " + std::to_string(first.height) +
                     " of the first one, and boxes are in its pixels");
  cv::Mat scaled;
  cv::resize(image, scaled, first, 0, 0, size.width > first.width ? cv::INTER_AREA : cv::INTER_LINEAR);
  return scaled;
}

bool ImageSource::skip(int count) {
  for (; count > 0; --count, ++position_) {
    if (video_.isOpened() ? !video_.grab() : position_ == frame_count_) return false;
    if (is_file_) append_time(video_, times_);
  }
  return true;
}

}  // namespace asterism::tools
