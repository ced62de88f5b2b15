#pragma once

#include <CLI/CLI.hpp>
#include <asterism/solver/base/edit_distance.hpp>
#include <cstddef>
#include <string>
#include <vector>

namespace asterism::tools {

/// What is wrong with a command line. CLI11 names an argument that is missing before one that it does not
/// know, and suggests no name.
inline std::string problem_with(const CLI::App& app, const CLI::ParseError& error) {
  const std::vector<std::string> rest = app.remaining(true);
  const bool is_unknown = !rest.empty() && (dynamic_cast<const CLI::RequiredError*>(&error) != nullptr ||
                                            dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr);
  std::vector<std::string> commands, known;
  if (app.get_subcommands().empty()) {  // of those that were given
    for (const CLI::App* each : app.get_subcommands([](const CLI::App*) { return true; }))
      commands.push_back(each->get_name());
  }
  const auto add_options = [&known](const CLI::App& options) {
    for (const CLI::Option* option : options.get_options())
      for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  };
  for (const CLI::App* command : app.get_subcommands()) add_options(*command);
  add_options(app);
  std::string text = is_unknown ? "unknown argument " + rest.front() : error.what();
  if (is_unknown)
    text.append(detail::near_name(rest.front(), rest.front().starts_with('-') ? known : commands));
  for (std::size_t i = 0; i < commands.size(); ++i)
    text.append(i == 0 ? " (commands: " : ", ").append(commands[i]);
  return text.append(commands.empty() ? "" : ")").append("; see --help");
}

}  // namespace asterism::tools
