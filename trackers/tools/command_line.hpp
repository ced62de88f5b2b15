#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

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

}  // namespace asterism::tools
