// Microbenchmarks of the parts: fHOG beside dlib's, the FFT, one KCF step, the colour model.
//   asterism-parts-bench [--benchmark_filter=REGEX]

#include <benchmark/benchmark.h>
#include <dlib/image_transforms.h>
#include <dlib/opencv.h>

#include <asterism/parts/colour.hpp>
#include <asterism/parts/fft.hpp>
#include <asterism/parts/fhog.hpp>
#include <asterism/parts/kcf.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

namespace {

using namespace asterism;

cv::Mat texture(int side, int type) {
  cv::Mat image(side, side, type);
  cv::RNG random(1);
  random.fill(image, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(image, image, {}, 2);
  return image;
}

void fhog(benchmark::State& state) {
  const cv::Mat patch = texture(static_cast<int>(state.range(0)), CV_8UC1);
  Fhog hog(4);
  std::vector<float> features(
      static_cast<std::size_t>(Fhog::kChannels * (patch.rows / 4) * (patch.cols / 4)));
  for (auto _ : state) {
    hog.compute(patch, features.data());
    benchmark::DoNotOptimize(features.data());
  }
}
BENCHMARK(fhog)->Arg(100)->Arg(200);

void fhog_dlib(benchmark::State& state) {
  const cv::Mat patch = texture(static_cast<int>(state.range(0)), CV_8UC1);
  const dlib::cv_image<unsigned char> image(patch);
  dlib::array<dlib::array2d<float>> features;
  for (auto _ : state) {
    dlib::extract_fhog_features(image, features, 4);
    benchmark::DoNotOptimize(&features);
  }
}
BENCHMARK(fhog_dlib)->Arg(100)->Arg(200);

void fft_forward(benchmark::State& state) {
  const int side = static_cast<int>(state.range(0)), channels = static_cast<int>(state.range(1));
  const RealFft2<float> fft(side, side, channels);
  Eigen::ArrayXf image = Eigen::ArrayXf::Random(side * side * channels);
  Eigen::ArrayXcf spectrum(side * fft.spectrum_cols() * channels);
  for (auto _ : state) {
    fft.forward(image.data(), spectrum.data());
    benchmark::DoNotOptimize(spectrum.data());
  }
}
BENCHMARK(fft_forward)->Args({24, 32})->Args({48, 32})->Args({52, 32})->Args({64, 32});

// Detection and training of one filter on a square target of the given side.
void kcf_step(benchmark::State& state) {
  const cv::Mat image = texture(400, CV_8UC3);
  const Frame frame(image);
  const double side = static_cast<double>(state.range(0));
  Kcf kcf;
  kcf.init(frame, {200, 200}, {side, side});
  for (auto _ : state) {
    const Evidence evidence = kcf.localize(frame, {200, 200});
    kcf.adapt(frame, evidence.position);
  }
}
BENCHMARK(kcf_step)->Arg(40)->Arg(80);

void colour_segment(benchmark::State& state) {
  const cv::Mat image = texture(400, CV_8UC3);
  const Frame frame(image);
  ColourModel model;
  model.init(frame, {160, 160, 80, 80});
  for (auto _ : state) benchmark::DoNotOptimize(model.segment(frame, {100, 100, 200, 200}, {80, 80}));
}
BENCHMARK(colour_segment);

}  // namespace

int main(int argc, char** argv) {
  cv::setNumThreads(1);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
}
