// video FILE: writes a small video of a textured object that starts at the box in README.md's example and
// moves over a textured background; prints the number of frames and the final box.
#include <iostream>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

namespace {

// Blobs of a few pixels, the same in every run.
cv::Mat texture(cv::Size size, std::uint64_t seed, const cv::Scalar& tint) {
  cv::RNG random(seed);
  cv::Mat coarse(size.height / 4, size.width / 4, CV_8UC3), fine;
  random.fill(coarse, cv::RNG::UNIFORM, 0, 160);
  cv::resize(coarse, fine, size, 0, 0, cv::INTER_CUBIC);
  return fine + tint;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  constexpr int kFrames = 40;
  const cv::Mat background = texture({320, 240}, 3, {60, 0, 0});
  const cv::Mat object = texture({48, 64}, 9, {0, 0, 80});
  cv::VideoWriter video(argv[1], cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 25,
                        background.size());
  if (!video.isOpened()) return 1;
  cv::Point corner;
  for (int t = 0; t < kFrames; ++t) {
    corner = {100 + 2 * t, 80 + t};
    cv::Mat frame = background.clone();
    object.copyTo(frame(cv::Rect(corner, object.size())));
    video.write(frame);
  }
  std::cout << "frames " << kFrames << ", last box at " << corner.x << " " << corner.y << "\n";
}
