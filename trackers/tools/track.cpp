// asterism-track: follows objects through a video and writes their boxes.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <string>
#include <vector>

#include "range_option.hpp"
#include "run.hpp"
#include "run_tool.hpp"
#include "tool_main.hpp"
#include "tracker_option.hpp"

namespace {

constexpr char kProgram[] = "asterism-track";

void stop_cleanly_on_signals() {
  struct sigaction action = {};
  action.sa_handler = [](int signal) { asterism::tools::g_stop_signal = signal; };
  action.sa_flags =
      static_cast<int>(SA_RESETHAND | SA_RESTART);  // the second Ctrl-C ends the process at once
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);  // if the reader of `--out -` exits, the write fails like any other
}

int run_command_line(int argc, char** argv) {
  using namespace asterism::tools;
  open_standard_streams();
  silence_libraries();

  Options options;
  CLI::App app("Tracks objects in a video; writes their boxes as CSV, and an overlay video.", kProgram);
  app.add_option(
         "INPUT", options.input,
         "video file, camera index, image folder, image pattern (img_%05d.jpg, '*.jpg') or VOT sequence")
      ->required();
  const CLI::Range count(1, 1'000'000'000);
  app.add_option("--box", options.boxes,
                 "x,y,w,h of the object in the first frame [px], or the corners x1,y1,x2,y2,.. of a polygon; "
                 "default: from the ground truth; repeat it for each further object")
      ->allow_extra_args(false);
  add_tracker_options(app, options.tracker);
  app.add_option("--out", options.out,
                 "CSV file of the boxes, one line for each frame; - for standard output");
  app.add_option("--save", options.save, "overlay video (.mp4)");
  app.add_option("--sheet", options.sheet, "contact sheet of eight frames (.png)");
  app.add_option("--compare", options.compare,
                 "another tracker whose box is drawn on the sheet; may be repeated")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  app.add_option("--timeline", options.timeline, "the parts' weights and the update gate over time (.png)");
  app.add_option("--constellation", options.constellation,
                 "dpt's constellation before and after its optimisation in the last frame (.png)");
  app.add_option("--record-systems", options.systems,
                 "file of the spring systems that dpt solves, with their starts, as JSON lines (.jsonl)");
  app.add_flag("--smooth", options.smooth,
               "smooth the boxes over time when all frames have been tracked; the outputs are written then, "
               "for which the input is read again");
  app.add_flag("--show", options.show,
               "show the overlay; q stops, space pauses; without --box, select the first box with the mouse");
  app.add_option("--start", options.start, "number of the first frame, from 1")->check(count);
  app.add_flag("--wait", options.wait,
               "start in the first frame that shows a scene, from --start on: not one gray level, noise or "
               "damaged");
  app.add_option("--frames", options.frames, "stop after this many frames")->check(count);
  add_range_options(app, options.source.range);
  app.add_option("--rotate", options.source.rotate,
                 "degrees to rotate frames clockwise; default: from the video")
      ->check(CLI::IsMember({0, 90, 180, 270}));
  app.add_option("--fps", options.source.fps,
                 "frames per second of the overlay; default: from the video, 25 for images")
      ->check(CLI::Range(1.0, 1000.0));
  app.set_version_flag("--version", ASTERISM_VERSION);
  try {
    app.parse(argc, argv);
    options.config = app["--config"]->empty() ? "" : app["--config"]->as<std::string>();
    stop_cleanly_on_signals();
    run(options);
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);
    // A shell expands an unquoted *.jpg to many arguments.
    const std::vector<std::string> rest = app.remaining();
    const bool inputs =
        !rest.empty() && std::none_of(rest.begin(), rest.end(),
                                      [](const std::string& argument) { return argument.starts_with('-'); });
    return fail(kProgram,
                inputs ? "one INPUT is taken, put a pattern in quotes: '*.jpg'"
                       : asterism::tools::problem_with(app, e),
                2);
  }
  return g_stop_signal == 0 ? 0 : 128 + g_stop_signal;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run_command_line(argc, argv);
  } catch (const std::exception& e) {
    return asterism::tools::fail(kProgram, e.what(), 1);
  }
}
