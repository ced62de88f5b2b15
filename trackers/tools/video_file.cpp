#include "video_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <opencv2/videoio.hpp>
#include <opencv2/videoio/registry.hpp>
#include <string>
#include <vector>

namespace asterism::tools {
namespace {

// Numbers and texts anywhere in a file; beyond its end they are 0 and empty.
class Reader {
 public:
  explicit Reader(const std::filesystem::path& file) : stream_(file, std::ios::binary | std::ios::ate) {
    if (stream_) size_ = static_cast<std::uint64_t>(std::max<std::int64_t>(stream_.tellg(), 0));
  }
  std::uint64_t size() const { return size_; }
  std::string text(std::uint64_t at, std::size_t length) {
    std::string bytes(length, '\0');
    if (at > size_ || length > size_ - at) return {};
    stream_.seekg(static_cast<std::streamoff>(at));
    stream_.read(bytes.data(), static_cast<std::streamsize>(length));
    return bytes;
  }
  std::uint64_t number(std::uint64_t at, std::size_t length, bool big_endian = true) {
    std::string bytes = text(at, length);
    if (!big_endian) std::reverse(bytes.begin(), bytes.end());
    std::uint64_t value = 0;
    for (const char c : bytes) value = value << 8 | static_cast<unsigned char>(c);
    return value;
  }

 private:
  std::ifstream stream_;
  std::uint64_t size_ = 0;
};

// A Matroska size at `at`, which is moved behind it; empty if the size is unknown, as in a live stream.
std::optional<std::uint64_t> matroska_size(Reader& file, std::uint64_t& at) {
  const std::uint64_t first = file.number(at, 1);
  unsigned length = 1;
  while (length < 8 && (first & (0x100U >> length)) == 0) ++length;
  const std::uint64_t mask = (std::uint64_t{1} << 7 * length) - 1, value = file.number(at, length) & mask;
  at += length;
  return value == mask ? std::nullopt : std::optional(value);
}

bool matroska_is_cut(Reader& file) {
  std::uint64_t at = 4;
  const auto header = matroska_size(file, at);
  if (!header || file.number(at + *header, 4) != 0x18538067) return false;
  at += *header + 4;
  const auto segment = matroska_size(file, at);
  return segment && *segment > file.size() - std::min(at, file.size());
}

bool mp4_is_cut(Reader& file) {
  for (std::uint64_t at = 0; at != file.size();) {
    const std::uint64_t length = file.number(at, 4), box = length == 1 ? file.number(at + 8, 8) : length;
    if (length == 0) return false;  // the last box, up to the end
    if (box < 8 || box > file.size() - at) return true;
    at += box;
  }
  return false;
}

// A file ends in the length of its last tag.
bool flv_is_cut(Reader& file) {
  const std::uint64_t length = file.number(file.size() - 4, 4), tag = file.size() - 4 - length;
  return length < 11 || length > file.size() - 4 || file.number(tag + 1, 3) + 11 != length;
}

}  // namespace

VideoContainer read_container(const std::filesystem::path& path) {
  Reader file(path);
  if (file.size() < 16) return {};
  if (file.text(0, 4) == "RIFF") return {.cut = file.number(4, 4, false) + 8 > file.size()};
  if (file.number(0, 4) == 0x1a45dfa3) return {matroska_is_cut(file), true};
  if (file.text(4, 4) == "ftyp") return {.cut = mp4_is_cut(file)};
  if (file.text(0, 3) == "FLV") return {flv_is_cut(file), true};
  return {};
}

int count_packets(const std::filesystem::path& file) {
  int count = 0;
  if (!cv::videoio_registry::hasBackend(cv::CAP_FFMPEG)) return count;
  for (cv::VideoCapture video(file.string(), cv::CAP_FFMPEG, {cv::CAP_PROP_FORMAT, -1}); video.grab();)
    ++count;
  return count;
}

std::optional<double> steady_interval(std::span<const double> times) {
  if (times.size() < 3) return {};
  std::vector<double> intervals;
  for (std::size_t i = 1; i < times.size(); ++i) intervals.push_back(times[i] - times[i - 1]);
  const auto middle = intervals.begin() + std::ssize(intervals) / 2;
  std::nth_element(intervals.begin(), middle, intervals.end());
  const double median = *middle;
  constexpr double kTick = 1e-3;  // [s], of Matroska and FLV: 33 and 34 ms alternate at 30 frames a second
  const auto equal = std::count_if(intervals.begin(), intervals.end(), [&](double interval) {
    return std::abs(interval - median) <= std::max(0.1 * median, 1.01 * kTick);
  });
  if (!(median > kTick) || 10 * equal < 9 * std::ssize(intervals)) return {};
  return median;
}

std::optional<MissingFrames> missing_frames(std::span<const double> times) {
  const std::optional<double> interval = steady_interval(times);
  if (!interval) return {};
  MissingFrames missing;
  constexpr double kMost = 1e6;  // a jump in time, rather than a gap
  for (std::size_t i = 1; i < times.size(); ++i) {
    const auto lost = std::lround(std::min((times[i] - times[i - 1]) / *interval, kMost)) - 1;
    if (lost < 2) continue;
    if (missing.count == 0) missing.after = static_cast<int>(i);
    missing.count += static_cast<int>(lost);
  }
  return missing.count > 0 ? std::optional(missing) : std::nullopt;
}

}  // namespace asterism::tools
