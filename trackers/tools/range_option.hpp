#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "image_file.hpp"

namespace asterism::tools {

/// The options --bits and --range, which set the range of the pixels of images.
inline void add_range_options(CLI::App& app, std::optional<PixelRange>& range) {
  CLI::Option* const bits = app.add_option_function<int>(
                                   "--bits", [&range](int count) { range = PixelRange::of_bits(count); },
                                   "bits that the pixels use, such as 10, 12 or 14 in 16-bit images")
                                ->check(CLI::Range(1, 16));
  app.add_option_function<std::string>(
         "--range",
         [&range](const std::string& text) {
           try {
             range = parse_range(text);
           } catch (const std::invalid_argument& error) {
             throw CLI::ValidationError("--range", error.what());
           }
         },
         "LOW,HIGH: the pixel values of black and of white")
      ->excludes(bits);
}

}  // namespace asterism::tools
