#include "outputs.hpp"

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

namespace asterism::tools {
namespace {

namespace fs = std::filesystem;

// printf is not used, as a window's toolkit may have set a locale with decimal commas.
void append(std::string& line, double value, int decimals = 4) {
  std::array<char, 400> buffer;
  const auto end =
      std::to_chars(buffer.data(), buffer.data() + buffer.size(), value, std::chars_format::fixed, decimals)
          .ptr;
  line.append(buffer.data(), end);
}

}  // namespace

std::string why() { return errno == 0 ? "" : std::string(": ") + std::strerror(errno); }

CsvFile::CsvFile(const std::string& path, bool several)
    : several_(several), name_(path == "-" ? "the standard output" : path) {
  errno = 0;
  if (path == "-") {
    stream_ = &std::cout;
  } else {
    file_.open(path);
    if (!file_) throw std::runtime_error("cannot write " + name_ + why());
    stream_ = &file_;
  }
  write(std::string(several ? "frame,id" : "frame") +
        ",x,y,width,height,confidence,lost,milliseconds,probability\n");
}

void CsvFile::add(int frame, std::span<const TrackResult> objects, double milliseconds) {
  std::string lines;
  for (int id = 1; const TrackResult& result : objects) {
    lines += std::to_string(frame);
    if (several_) lines += ',' + std::to_string(id++);
    for (const double value :
         {result.box.x, result.box.y, result.box.width, result.box.height, result.confidence}) {
      append(lines += ',', value);
    }
    lines += result.lost ? ",1," : ",0,";
    append(lines, milliseconds, 3);
    lines += ',';
    if (result.probability) append(lines, *result.probability, 3);
    lines += '\n';
  }
  write(lines);
}

void CsvFile::write(const std::string& line) {
  errno = 0;
  *stream_ << line << std::flush;
  if (!*stream_) throw std::runtime_error("cannot write " + name_ + why());
}

void VideoFile::add(const cv::Mat& frame) {
  if (!writer_.isOpened()) {
    // The encoder needs even sizes.
    size_ = cv::Size(frame.cols & ~1, frame.rows & ~1);
    bool opened = false;
    try {
      opened = writer_.open(path_.string(), cv::VideoWriter::fourcc('m', 'p', '4', 'v'), fps_, size_);
    } catch (const cv::Exception&) {
      opened = false;
    }
    if (!opened) {
      throw std::runtime_error("cannot write the video " + path_.string() +
                               " (the folder, its name's ending, or OpenCV's FFmpeg back end)");
    }
  }
  if (frame.size() == size_) {
    writer_.write(frame);
  } else {
    cv::Mat fitted;
    if (frame.cols - size_.width <= 1 && frame.rows - size_.height <= 1 && frame.cols >= size_.width &&
        frame.rows >= size_.height) {
      fitted = frame(cv::Rect({0, 0}, size_));
    } else {
      cv::resize(frame, fitted, size_, 0, 0, cv::INTER_AREA);
    }
    writer_.write(fitted);
  }
}

void VideoFile::close() {
  if (!writer_.isOpened()) return;
  writer_.release();
  // OpenCV does not report failed writes, but then the index at the end of the file is missing.
  cv::VideoCapture written(path_.string());
  cv::Mat frame;
  if (!written.isOpened() || !written.read(frame)) {
    throw std::runtime_error("the video " + path_.string() + " could not be completed (is the disk full?)");
  }
}

void check_output(const std::string& option, const fs::path& path) {
  std::error_code error;
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  if (!fs::is_directory(folder, error)) {
    throw std::runtime_error(option + " " + path.string() + ": no folder " + folder.string());
  }
  if (fs::is_directory(path, error)) throw std::runtime_error(option + " " + path.string() + " is a folder");
}

void write_image(const fs::path& path, const cv::Mat& image) {
  // Encoded in memory, as the codecs' own writing does not give the reason for a failure.
  std::vector<unsigned char> bytes;
  try {
    cv::imencode(path.extension().string(), image, bytes);
  } catch (const cv::Exception& e) {
    throw std::runtime_error("cannot write the image " + path.string() + ": " + e.err);
  }
  errno = 0;
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  file.flush();
  if (!file || bytes.empty()) throw std::runtime_error("cannot write the image " + path.string() + why());
}

}  // namespace asterism::tools
