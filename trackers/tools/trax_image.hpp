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

/// Decodes the image in a TraX message's argument: 8-bit BGR or as deep as the file, or one channel of 8 or
/// 16 bits. The argument is a path (plain or "file://"; nothing in it is decoded),
/// "image:width;height;rgb|gray8|gray16;" and the pixels in base64, or "data:image/jpeg;" and the file in
/// base64. With a range the result has 8 bits. A damaged file is a blank frame, see `read_frame`. Throws
/// TraxError.
FrameImage decode_trax_image(const std::string& argument, const std::optional<PixelRange>& range = {},
                             cv::Size otherwise = {});

/// A file, or pixels: 8-bit BGR, or one channel of 8 or 16 bits.
using TraxImage = std::variant<std::filesystem::path, cv::Mat>;

/// The argument that passes an image to a tracker that accepts `formats`, out of "path", "memory", "data" and
/// "buffer", a synonym of "data": a file as its path if possible, pixels without loss. Throws TraxError if
/// there is no such argument.
std::string encode_trax_image(const TraxImage& image, const std::vector<std::string>& formats);

}  // namespace asterism::tools
