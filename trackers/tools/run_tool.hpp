#pragma once

#include <CLI/CLI.hpp>
#include <exception>

#include "command_line.hpp"
#include "tool_main.hpp"

namespace asterism::tools {

/// The body of `main`: parses the command line, calls `run`, and returns the exit code. Errors are printed on
/// one line; the code is 2 for errors in the command line and 1 for exceptions of `run`.
template <typename Run>
int run_tool(CLI::App& app, int argc, char** argv, Run&& run) {
  open_standard_streams();
  silence_libraries();
  try {
    app.parse(argc, argv);
    run();
    flush_output();
    return 0;
  } catch (const CLI::ParseError& error) {
    return error.get_exit_code() == 0 ? app.exit(error) : fail(app.get_name(), problem_with(app, error), 2);
  } catch (const std::exception& error) {
    return fail(app.get_name(), error.what(), 1);
  }
}

}  // namespace asterism::tools
