#pragma once

#include <CLI/CLI.hpp>
#include <asterism/trackers/tracker/tracker.hpp>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "tool_main.hpp"

namespace asterism::tools {

/// Reads a tracker's description, a JSON object as `make_tracker` takes it, from a file or a named pipe.
/// Throws std::runtime_error, which names the file, if it cannot be read, has more than 1 MiB, or does not
/// describe a tracker.
inline std::string read_tracker(const std::string& path) {
  constexpr std::size_t kMost = std::size_t{1} << 20;
  std::ifstream file(path);
  if (std::filesystem::is_directory(path)) throw std::runtime_error(path + " is a folder, not a file");
  if (!file) throw std::runtime_error("cannot read " + path);
  std::string text(kMost + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (file.bad()) throw std::runtime_error("cannot read " + path);
  text.resize(static_cast<std::size_t>(file.gcount()));
  if (text.size() > kMost)
    throw std::runtime_error(path + ": more than 1 MiB, too large for the description of a tracker");
  text.erase(0, text.find_first_not_of(" \t\r\n"));
  if (!text.starts_with('{'))
    throw std::runtime_error(path + ": the description of a tracker must be a JSON object");
  try {
    make_tracker(text);
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(path + ": " + error.what());
  }
  return text;
}

/// Adds the options --tracker and --config, which set the description of a tracker, and --options, which
/// prints one and ends the program.
inline void add_tracker_options(CLI::App& app, std::string& description) {
  std::string names;
  for (const std::string& name : tracker_names()) names += name + ", ";
  CLI::Option* const tracker =
      app.add_option("--tracker", description,
                     names + R"(dpt+MODEL, dpt_net:FOLDER, or one with options: 'dpt{"part": "mosse"}')")
          ->capture_default_str();
  app.add_option_function<std::string>(
         "--config", [&description](const std::string& file) { description = read_tracker(file); },
         R"(JSON file that describes the tracker: {"tracker": "dpt", "part": "mosse"})")
      ->excludes(tracker);
  app.add_option_function<std::string>(
         "--options",
         [](const std::string& asked) {
           std::printf("%s\n", tracker_options(asked).c_str());
           flush_output();
           throw CLI::Success();
         },
         "print all options of a tracker (NAME as for --tracker) with their values, as JSON that --config "
         "takes, and exit")
      ->type_name("NAME");
}

}  // namespace asterism::tools
