#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "image_file.hpp"

namespace asterism::tools {

/// The image of a TraX message's argument, BGR of 8 bits or as deep as the file, or one channel of 8 or 16
/// bits: a path (plain or "file://", nothing in it is decoded), "image:width;height;rgb|gray8|gray16;" and
/// the pixels in base64, or "data:image/jpeg;" and the file in base64. With a range it has 8 bits. A file
/// that is damaged is a blank frame, see `read_frame`. Throws TraxError.
FrameImage decode_trax_image(const std::string& argument, const std::optional<PixelRange>& range = {},
                             cv::Size otherwise = {});

/// A file, or pixels of 8-bit BGR or of one channel with 8 or 16 bit.
using TraxImage = std::variant<std::filesystem::path, cv::Mat>;

/// The argument that says an image to a tracker that takes `formats`, of "path", "memory", "data" and
/// "buffer", another word for "data": a file as its path where that can be, pixels without loss. Throws
/// TraxError where there is no such argument.
std::string encode_trax_image(const TraxImage& image, const std::vector<std::string>& formats);

}  // namespace asterism::tools
