// asterism-track: follows one object through a video and writes where it was.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <string>
#include <vector>

#include "run.hpp"

namespace {

void stop_cleanly_on_signals() {
  struct sigaction action = {};
  action.sa_handler = [](int signal) { asterism::tools::g_stop_signal = signal; };
  action.sa_flags =
      static_cast<int>(SA_RESETHAND | SA_RESTART);  // the second Ctrl-C ends the process at once
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);  // a reader of `--out -` that goes is a failed write like another
}

// An error is one line, also where a library's message has more.
int fail(std::string reason, int code) {
  std::replace(reason.begin(), reason.end(), '\n', ' ');
  reason.erase(reason.find_last_not_of(' ') + 1);
  std::fprintf(stderr, "asterism-track: %s\n", reason.c_str());
  return code;
}

int run_command_line(int argc, char** argv) {
  using namespace asterism::tools;
  // Errors are reported here, in one line; what the libraries print themselves only repeats them.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; });
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);

  Options options;
  CLI::App app("Follows one object through a video; writes its boxes as CSV and an overlay to look at.",
               "asterism-track");
  app.add_option(
         "INPUT", options.input,
         "video file, camera index, image folder, image pattern (img_%05d.jpg, '*.jpg') or VOT sequence")
      ->required();
  const CLI::Range count(1, 1'000'000'000);
  app.add_option("--box", options.box,
                 "x,y,w,h of the object in the first frame [px]; default: ground truth");
  app.add_option("--tracker", options.tracker, "tracker to run")->capture_default_str();
  app.add_option("--out", options.out, "CSV file of the boxes, one line a frame; - for standard output");
  app.add_option("--save", options.save, "overlay video (.mp4)");
  app.add_option("--sheet", options.sheet, "contact sheet of eight frames (.png)");
  app.add_option("--record-systems", options.systems,
                 "file of the spring systems that dpt solves, with their starts, as JSON lines (.jsonl)");
  app.add_flag("--show", options.show,
               "show the overlay; q stops, space pauses; also to select the first box");
  app.add_option("--start", options.start, "number of the first frame, from 1")->check(count);
  app.add_option("--frames", options.frames, "stop after this many frames")->check(count);
  app.set_version_flag("--version", ASTERISM_VERSION);
  try {
    app.parse(argc, argv);
    stop_cleanly_on_signals();
    run(options);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);
    // A shell makes many arguments of an unquoted *.jpg.
    const std::vector<std::string> rest = app.remaining();
    const bool inputs =
        !rest.empty() && std::none_of(rest.begin(), rest.end(),
                                      [](const std::string& argument) { return argument.starts_with('-'); });
    return fail(inputs ? "one INPUT is taken, put a pattern in quotes: '*.jpg'" : e.what(), 2);
  }
  return g_stop_signal == 0 ? 0 : 128 + g_stop_signal;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run_command_line(argc, argv);
  } catch (const std::exception& e) {
    return fail(e.what(), 1);
  }
}
