// asterism-theory-pictures FOLDER: the pictures of docs/theory.md, each of a scene that is drawn here. Ends
// with an error where one does not show what the page says of it.
#include <asterism/parts/models/color.hpp>
#include <asterism/parts/models/kcf.hpp>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

namespace asterism {
namespace {

constexpr int kPanel = 160, kGap = 8;  // [px]
const cv::Scalar kMark(0, 140, 255);   // orange

// Panels side by side; transparent between them, so that it suits pages of any color.
void write(const std::filesystem::path& path, const std::vector<cv::Mat>& panels) {
  cv::Mat picture;
  for (const cv::Mat& panel : panels) {
    cv::Mat next;
    cv::cvtColor(panel, next, cv::COLOR_BGR2BGRA);
    if (!picture.empty()) {
      cv::copyMakeBorder(next, next, 0, 0, kGap, 0, cv::BORDER_CONSTANT, cv::Scalar::all(0));
      cv::hconcat(picture, next, next);
    }
    picture = next;
  }
  if (!cv::imwrite(path.string(), picture, {cv::IMWRITE_PNG_COMPRESSION, 9}))
    throw std::runtime_error("cannot write " + path.string());
}

// A map from its least to its greatest value.
cv::Mat shown(const cv::Mat& map, int colors) {
  cv::Mat levels, panel;
  cv::normalize(map, levels, 0, 255, cv::NORM_MINMAX, CV_8U);
  cv::applyColorMap(levels, panel, colors);
  cv::resize(panel, panel, {kPanel, kPanel}, 0, 0, cv::INTER_NEAREST);
  return panel;
}

cv::Mat texture(int side, int seed) {
  cv::Mat image(side, side, CV_8U);
  cv::RNG(static_cast<std::uint64_t>(seed)).fill(image, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(image, image, {9, 9}, 0);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
  return image;
}

// A textured square of 64 px that moves by (26, -18) px.
void draw_kcf(const std::filesystem::path& path) {
  constexpr int kSide = 64;
  const cv::Rect first(88, 88, kSide, kSide), second = first + cv::Point(26, -18);
  const cv::Mat background = texture(240, 1) * 0.5 + cv::Scalar::all(60), object = texture(kSide, 2);
  cv::Mat images[2];
  for (int i = 0; i < 2; ++i) {
    images[i] = background.clone();
    object.copyTo(images[i](i == 0 ? first : second));
  }
  const Frame before(images[0]), after(images[1]);
  const Point2 centre = centre_of(first);

  const auto response_to = [&](const KcfOptions& options, ResponseMap& map) {
    Kcf kcf(options);
    kcf.init(before, centre, Size2(kSide, kSide));
    const Evidence evidence = kcf.localize(after, centre);
    map = kcf.response();
    return evidence;
  };
  ResponseMap response, kernel;
  const Evidence evidence = response_to({}, response);
  // A label that is 1 at one shift alone, divided by lambda in place of the spectrum: what remains is k /
  // lambda.
  KcfOptions kernel_alone;
  kernel_alone.label_sigma = 1e-3;
  kernel_alone.lambda = 1e9;
  response_to(kernel_alone, kernel);

  if ((evidence.position - centre_of(second)).norm() > 1)
    throw std::runtime_error("KCF does not find the target");
  const auto above_half = [](const ResponseMap& map) {
    return (map.values > (map.values.minCoeff() + map.values.maxCoeff()) / 2).count();
  };
  if (above_half(kernel) < 3 * above_half(response))
    throw std::runtime_error("the response is no narrower than the kernel");

  // All four show the search window.
  const Point2 corner = response.origin - response.spacing / 2;
  const cv::Rect window(cvRound(corner.x()), cvRound(corner.y()),
                        cvRound(response.spacing.x() * static_cast<double>(response.values.cols())),
                        cvRound(response.spacing.y() * static_cast<double>(response.values.rows())));
  const double scale = double(kPanel) / window.width;
  const auto at = [&](const Point2& p) {
    return cv::Point(cvRound((p.x() - window.x) * scale), cvRound((p.y() - window.y) * scale));
  };
  cv::Mat pictures[2];
  for (int i = 0; i < 2; ++i) {
    cv::resize(images[i](window), pictures[i], {kPanel, kPanel});
  }
  const Point2 half(kSide / 2.0, kSide / 2.0);
  cv::rectangle(pictures[0], at(centre - half), at(centre + half), kMark, 2);
  cv::drawMarker(pictures[1], at(evidence.position), kMark, cv::MARKER_CROSS, 24, 2);
  const auto map_of = [](ResponseMap& map) {
    return cv::Mat(static_cast<int>(map.values.rows()), static_cast<int>(map.values.cols()), CV_32F,
                   map.values.data());
  };
  write(path, {pictures[0], pictures[1], shown(map_of(kernel), cv::COLORMAP_VIRIDIS),
               shown(map_of(response), cv::COLORMAP_VIRIDIS)});
}

// A reddish ellipse on green, in colors that vary from block to block, with stains of either color on the
// other.
void draw_color(const std::filesystem::path& path) {
  constexpr int kBlock = 2;
  const cv::Rect box(46, 33, 68, 94);
  cv::RNG random(3);
  const auto ellipse = [&](cv::Mat& image, const cv::Scalar& color) {
    cv::ellipse(image, (box.tl() + box.br()) / 2, box.size() / 2, 0, 0, 360, color, cv::FILLED);
  };
  cv::Mat truth(kPanel, kPanel, CV_8U, cv::Scalar::all(0));
  ellipse(truth, cv::Scalar::all(255));
  cv::Mat is_red = truth.clone();
  for (int i = 0; i < 70; ++i) {
    const cv::Point at(random.uniform(0, kPanel), random.uniform(0, kPanel));
    cv::circle(is_red, at, random.uniform(2, 6), cv::Scalar::all(255 - truth.at<std::uint8_t>(at)),
               cv::FILLED);
  }
  cv::Mat image(is_red.size(), CV_8UC3, cv::Scalar(70, 140, 90)),
      noise(kPanel / kBlock, kPanel / kBlock, CV_8UC3);
  image.setTo(cv::Scalar(60, 80, 180), is_red);
  random.fill(noise, cv::RNG::UNIFORM, 0, 70);
  cv::resize(noise, noise, image.size(), 0, 0, cv::INTER_NEAREST);
  image += noise;

  const Frame frame(image);
  const auto segmented = [&](bool with_field) {
    ColorOptions options;
    options.mrf.enabled = with_field;
    ColorModel model(options);
    model.init(frame, box);
    return model.segment(frame, cv::Rect({}, image.size()), Size2(box.width, box.height));
  };
  const Segmentation alone = segmented(false), field = segmented(true);
  const auto wrong = [&](const Segmentation& segmentation) {
    int count = 0;
    for (int row = 0; row < segmentation.posterior.rows; ++row)
      for (int col = 0; col < segmentation.posterior.cols; ++col) {
        const Point2 at = segmentation.origin + segmentation.spacing.cwiseProduct(Point2(col, row));
        const bool object = truth.at<std::uint8_t>(cvRound(at.y()), cvRound(at.x())) != 0;
        count += (segmentation.posterior.at<float>(row, col) > 0.5f) != object;
      }
    return count;
  };
  std::printf("wrong cells: %d by color alone, %d by the field, of %d\n", wrong(alone), wrong(field),
              static_cast<int>(field.posterior.total()));
  if (2 * wrong(field) > wrong(alone)) throw std::runtime_error("the field does not mend half of the cells");

  cv::Mat outlined = image.clone(), mask, boxed = image.clone();
  cv::resize(field.posterior, mask, image.size());
  std::vector<std::vector<cv::Point>> outlines;
  cv::findContours(mask > 0.5, outlines, cv::RETR_LIST, cv::CHAIN_APPROX_NONE);
  cv::drawContours(outlined, outlines, -1, cv::Scalar::all(255), 2);
  cv::rectangle(boxed, box, cv::Scalar::all(255), 2);
  write(path, {boxed, shown(alone.posterior, cv::COLORMAP_BONE), shown(field.posterior, cv::COLORMAP_BONE),
               outlined});
}

}  // namespace
}  // namespace asterism

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: asterism-theory-pictures FOLDER\n", stderr);
    return 2;
  }
  try {
    const std::filesystem::path folder(argv[1]);
    std::filesystem::create_directories(folder);
    asterism::draw_kcf(folder / "theory-kcf.png");
    asterism::draw_color(folder / "theory-color.png");
  } catch (const std::exception& e) {
    std::fprintf(stderr, "asterism-theory-pictures: %s\n", e.what());
    return 1;
  }
}
