#include "trajectory.hpp"

#include <algorithm>
#include <array>
#include <asterism/solver/base/counted.hpp>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <stdexcept>

#include "ground_truth.hpp"
#include "statistics.hpp"
#include "text.hpp"

namespace asterism::bench {
namespace {

namespace fs = std::filesystem;

std::string content_of(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) fail(path, std::strerror(errno));
  std::string content{std::istreambuf_iterator<char>(file), {}};
  if (file.bad()) fail(path, "cannot be read");
  return content;
}

std::vector<TrajectoryFrame> read_text(const fs::path& path) {
  std::vector<std::string> lines = tools::read_lines(path);
  while (!lines.empty() && lines.back().find_first_not_of(" \t") == std::string::npos) lines.pop_back();
  std::vector<std::vector<double>> numbers;
  for (const std::string& line : lines) numbers.push_back(tools::parse_numbers(line));
  if (tools::are_mot_lines(numbers)) fail(path, 1, tools::kMotAdvice);
  std::vector<TrajectoryFrame> frames;
  for (const std::string& line : lines) {
    const std::vector<double>& v = numbers[frames.size()];
    const std::size_t number = frames.size() + 1;
    if (line.starts_with('m')) fail(path, number, "masks are not supported");
    if (v.empty()) fail(path, number, "not a region: \"" + line.substr(0, 60) + "\"");
    const auto finite = static_cast<std::size_t>(
        std::count_if(v.begin(), v.end(), [](double d) { return std::isfinite(d); }));
    TrajectoryFrame frame;
    if (finite == v.size() && v.size() == 1) {
      if (v[0] < 0 || v[0] > 255 || v[0] != std::floor(v[0])) fail(path, number, "not a code of the toolkit");
      frame.code = static_cast<int>(v[0]);
    } else if (finite == 1 && v.size() == 4 && std::isfinite(v[3]) && v[3] <= 0 && v[3] > -255) {
      frame.code = static_cast<int>(-v[3]);  // the oldest toolkits: NaN,NaN,NaN,-code
    } else if (finite > 0) {
      frame.region = tools::to_region(v);
      if (!frame.region) fail(path, number, "neither a rectangle nor a polygon of up to 10,000 corners");
    }
    frames.push_back(std::move(frame));
  }
  if (frames.empty()) fail(path, 1, "no frames");
  return frames;
}

// The toolkit's binary format: little endian; int16 1, uint32 number of frames, and for each frame uint8
// type: 0 uint32 code; 1 four floats; 2 uint16 corners, floats x and y of each; 3 mask; 4 point.
class BinaryReader {
 public:
  explicit BinaryReader(const fs::path& path) : path_(path), content_(content_of(path)) {}

  std::vector<TrajectoryFrame> frames() {
    if (integer<std::uint16_t>() != 1) fail("not a trajectory of version 1");
    const auto count = integer<std::uint32_t>();
    if (count == 0) fail("no frames");
    std::vector<TrajectoryFrame> frames;
    for (frame_ = 1; frame_ <= count; ++frame_) frames.push_back(frame());
    if (at_ != content_.size()) fail("more follows after the last frame");
    return frames;
  }

 private:
  [[noreturn]] void fail(const std::string& reason) const {
    bench::fail(path_, frame_ == 0 ? reason : "frame " + std::to_string(frame_) + ": " + reason);
  }

  template <class T>
  T integer() {
    if (content_.size() - at_ < sizeof(T)) fail("the file ends within it");
    T value = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i)
      value = static_cast<T>(value | static_cast<T>(static_cast<unsigned char>(content_[at_++])) << (8 * i));
    return value;
  }

  std::vector<double> floats(std::size_t count) {
    std::vector<double> values;
    for (std::size_t i = 0; i < count; ++i) {
      const auto bits = integer<std::uint32_t>();
      float value;
      std::memcpy(&value, &bits, sizeof value);
      values.push_back(value);
    }
    return values;
  }

  TrajectoryFrame frame() {
    TrajectoryFrame frame;
    const int type = integer<std::uint8_t>();
    if (type == 0) {
      const auto code = integer<std::uint32_t>();
      if (code > 255) fail("not a code of the toolkit");
      frame.code = static_cast<int>(code);
    } else if (type == 1 || type == 2) {
      const std::vector<double> values = floats(type == 1 ? 4 : std::size_t{2} * integer<std::uint16_t>());
      if (type == 2 && values.size() == 4) fail("a polygon of two corners");
      frame.region = tools::to_region(values);
      if (!frame.region) fail("neither a rectangle nor a polygon");
    } else {
      fail(type == 3 || type == 4 ? "masks and points are not supported" : "unknown type of region");
    }
    return frame;
  }

  const fs::path& path_;
  std::string content_;
  std::size_t at_ = 0, frame_ = 0;
};

// One number per line, NaN for a blank line; nullopt if a line is anything else.
std::optional<std::vector<double>> read_values(const fs::path& path, std::size_t frames) {
  std::vector<double> values;
  for (const std::string& line : tools::read_lines(path)) {
    const std::vector<double> numbers = tools::parse_numbers(line);
    const bool blank = line.find_first_not_of(" \t") == std::string::npos;
    if (numbers.size() > 1 || (numbers.empty() && !blank)) return {};
    values.push_back(blank ? kNone : numbers[0]);
  }
  if (values.size() != frames)
    fail(path, values.size(),
         detail::counted(values.size(), "value") + ", but " + detail::counted(frames, "frame"));
  return values;
}

// The MATLAB toolkit's times [s]: one line per frame, one column per run.
std::vector<double> read_time_column(const fs::path& path, std::size_t run, std::size_t frames) {
  std::vector<double> times;
  const std::vector<std::string> lines = tools::read_lines(path);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const std::vector<double> columns = tools::parse_numbers(lines[i]);
    if (run > columns.size()) fail(path, i + 1, "no time of run " + std::to_string(run));
    times.push_back(columns[run - 1]);
  }
  if (times.size() != frames)
    fail(path, times.size(),
         detail::counted(times.size(), "time") + ", but " + detail::counted(frames, "frame"));
  return times;
}

std::string text_of(double value) {
  if (std::isnan(value)) return {};
  std::array<char, 32> buffer;
  return {buffer.data(), std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr};
}

fs::path with_extension(const fs::path& file, const char* extension) {
  fs::path other = file;
  return other.replace_extension(extension);
}

}  // namespace

fs::path results_folder(const fs::path& workspace, const std::string& tracker, const std::string& experiment,
                        const std::string& sequence) {
  return workspace / "results" / tracker / experiment / sequence;
}

std::string run_file(const std::string& sequence, int run) {
  std::array<char, 32> number;
  std::snprintf(number.data(), number.size(), "_%03d.txt", run);
  return sequence + number.data();
}

std::string anchor_file(const std::string& sequence, std::size_t anchor) {
  std::array<char, 32> number;
  std::snprintf(number.data(), number.size(), "_%08zu.txt", anchor);
  return sequence + number.data();
}

bool trajectory_exists(const fs::path& file) {
  return fs::exists(with_extension(file, ".bin")) || fs::exists(with_extension(file, ".txt"));
}

Trajectory read_trajectory(const fs::path& file) {
  Trajectory trajectory;
  const fs::path binary = with_extension(file, ".bin");
  trajectory.frames =
      fs::exists(binary) ? BinaryReader(binary).frames() : read_text(with_extension(file, ".txt"));
  const std::size_t frames = trajectory.frames.size();
  const fs::path folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
  const std::string name = file.stem().string();
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string stem = entry.path().stem().string();
    if (entry.path().extension() != ".value" || !stem.starts_with(name + "_")) continue;
    const std::string value = stem.substr(name.size() + 1);
    if (auto values = read_values(entry.path(), frames)) {
      trajectory.values[value] = std::move(*values);
    } else if (value == "time") {
      fail(entry.path(), "a line is not a number");
    }
  }
  if (const std::size_t underscore = name.rfind('_');
      underscore != std::string::npos && !trajectory.values.contains("time")) {
    const fs::path times = folder / (name.substr(0, underscore) + "_time.txt");
    std::size_t run = 0;
    std::from_chars(name.data() + underscore + 1, name.data() + name.size(), run);
    if (run > 0 && fs::exists(times)) trajectory.values["time"] = read_time_column(times, run, frames);
  }
  return trajectory;
}

void write_trajectory(const fs::path& file, const Trajectory& trajectory) {
  if (!file.parent_path().empty()) fs::create_directories(file.parent_path());
  for (const auto& [name, values] : trajectory.values) {
    if (values.size() != trajectory.frames.size())
      throw std::invalid_argument("a trajectory has " + detail::counted(trajectory.frames.size(), "frame") +
                                  ", but " + std::to_string(values.size()) + " of its " + name);
    std::string text;
    for (const double value : values) text += text_of(value) + '\n';
    write_atomically(file.parent_path() / (file.stem().string() + "_" + name + ".value"), text);
  }
  std::string text;
  for (const TrajectoryFrame& frame : trajectory.frames) {
    std::string line = frame.region ? to_string(*frame.region) : std::to_string(frame.code);
    if (frame.region && !tools::parse_region(line)) line = std::to_string(TrajectoryFrame::kUnknown);
    text += line + '\n';
  }
  write_atomically(with_extension(file, ".txt"), text);
}

void write_atomically(const fs::path& file, std::string_view content) {
  // The temporary file is hidden and has a unique name, as other processes may write the same file.
  std::string hidden = ".";
  hidden += file.filename().string() + "." + std::to_string(std::random_device()());
  const fs::path part = file.parent_path() / hidden;
  std::error_code error;
  errno = 0;
  std::ofstream stream(part, std::ios::binary);
  stream << content;
  stream.close();
  if (!stream) {
    const std::string reason = errno != 0 ? std::strerror(errno) : "cannot be written";
    fs::remove(part, error);
    fail(file, reason);
  }
  fs::rename(part, file, error);
  if (error) {
    const std::string reason = error.message();
    fs::remove(part, error);
    fail(file, reason);
  }
}

}  // namespace asterism::bench
