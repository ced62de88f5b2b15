#pragma once

#include <CLI/CLI.hpp>
#include <exception>
#include <string>
#include <vector>

#include "tool_main.hpp"

namespace asterism::tools {

/// What is wrong with a command line. CLI11 names an argument that is missing before one that it does not
/// know.
inline std::string problem_with(const CLI::App& app, const CLI::ParseError& error) {
  const std::vector<std::string> rest = app.remaining();
  const bool is_missing = dynamic_cast<const CLI::RequiredError*>(&error) != nullptr;
  std::string text = is_missing && !rest.empty() ? "unknown argument " + rest.front() : error.what();
  std::string commands;
  if (app.get_subcommands().empty()) {  // of those that were given
    for (const CLI::App* each : app.get_subcommands([](const CLI::App*) { return true; }))
      commands.append(commands.empty() ? " (commands: " : ", ").append(each->get_name());
  }
  return text.append(commands.empty() ? commands : commands.append(")")).append("; see --help");
}

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
