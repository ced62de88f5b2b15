#pragma once

#include <asterism/parts/concept/frame.hpp>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace asterism::tools {

/// Images of more pixels are refused before they are decoded: a file of some kilobytes can announce
/// gigabytes. Those of 16K video (15360 x 8640) are below.
inline constexpr std::int64_t kMostPixels = std::int64_t{1} << 27;

/// The properties of an image file that are known before it is decoded.
struct ImageHeader {
  cv::Size size = {};     ///< [px] of the largest page; empty where the file ends before it is told
  bool whole = true;      ///< false for a JPEG that ends before its end marker; decoders notice all others
  bool animated = false;  ///< PNG or WebP with several frames
  std::vector<std::uint64_t> pages = {};  ///< where in a TIFF those of full size begin; else empty
  int images = 1;                         ///< that the file holds, as far as it can be told cheaply
};

/// Of a JPEG, PNG, BMP, TIFF, WebP, JPEG 2000, portable anymap (PBM, PGM, PPM, PAM, PFM) or Sun raster file;
/// empty for any other file.
std::optional<ImageHeader> read_image_header(std::span<const unsigned char> bytes);

/// A frame read from a file, BGR.
struct FrameImage {
  cv::Mat pixels;
  bool damaged =
      false;  ///< the file is cut short or cannot be decoded: the pixels are a blank (128, 128, 128)
};

/// An image as a frame, the same for all programs. With a range 8 bits a channel, else as many as the file
/// has (8, 16 or float). A file that begins as an image and ends early or cannot be decoded, or that is
/// empty, is a damaged frame: a blank one of the size `otherwise`, or of the size that it announces where
/// that is empty. Throws std::runtime_error, with the file's name and the reason, where nothing can be taken
/// for a frame: no such file, no image of a known format, one of more than kMostPixels, or of several frames
/// or pages.
FrameImage read_frame(const std::filesystem::path& file, const std::optional<PixelRange>& range = {},
                      cv::Size otherwise = {});
/// The same from the bytes of a file of that name. first_page: of a TIFF with several, take the first one.
FrameImage decode_frame(std::span<const unsigned char> bytes, const std::string& name,
                        const std::optional<PixelRange>& range = {}, cv::Size otherwise = {},
                        bool first_page = false);
/// Makes a TIFF's page, one of ImageHeader::pages, the first of the file.
void make_first_page(std::span<unsigned char> tiff, std::uint64_t page);

/// The bytes of a file. Throws std::runtime_error, with its name, if it cannot be read, is not a file, or has
/// more than 2 GiB.
std::vector<unsigned char> read_bytes(const std::filesystem::path& file);

/// An image of any depth in 8 bits and BGR: by the range, or as Frame has it without one.
cv::Mat to_bgr8(const cv::Mat& image, const std::optional<PixelRange>& range = {});

/// The range that "LOW,HIGH" describes. Throws std::invalid_argument for anything else.
PixelRange parse_range(std::string_view text);

}  // namespace asterism::tools
