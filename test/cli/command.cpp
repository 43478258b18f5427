#include "command.hpp"

#include <array>
#include <cstdio>
#include <iomanip>
#include <sstream>
#include <stdexcept>

#include <gtest/gtest.h>
#include <sys/wait.h>

#include "support/temporary_file.hpp"

namespace helix_arm::test {
namespace {

std::string quoted(const std::string& argument) {
  std::string text = "'";
  for (const char c : argument) text += c == '\'' ? "'\\''" : std::string(1, c);
  return text + "'";
}

}  // namespace

Outcome runCommand(const std::vector<std::string>& arguments) {
  const TemporaryFile errors("");
  std::string command = quoted(HELIX_ARM_COMMAND);
  for (const std::string& argument : arguments) command += " " + quoted(argument);
  command += " 2>" + quoted(errors.path());

  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("cannot run " + command);
  Outcome outcome{-1, {}, {}};
  std::array<char, 4096> buffer{};
  for (std::size_t n; (n = fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
    outcome.out.append(buffer.data(), n);
  const int status = pclose(pipe);
  if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
  outcome.err = contentOf(errors.path());
  return outcome;
}

Outcome runCommand(std::vector<std::string> arguments, const std::vector<std::string>& more) {
  arguments.insert(arguments.end(), more.begin(), more.end());
  return runCommand(arguments);
}

nlohmann::json resultOf(const std::vector<std::string>& arguments, int exit_code) {
  const Outcome outcome = runCommand(arguments, {"--format", "json"});
  EXPECT_EQ(outcome.exit_code, exit_code) << outcome.err << outcome.out;
  return outcome.json();
}

void expectCallerError(const Outcome& outcome, const std::string& message) {
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_EQ(outcome.out, "");
  EXPECT_NE(outcome.err.find(message), std::string::npos) << outcome.err;
}

std::string scenePath(const std::string& name) {
  return std::string(HELIX_ARM_SOURCE_DIR) + "/config/scenes/" + name + ".yaml";
}

std::string measured(const std::string& name) {
  return std::string(HELIX_ARM_SOURCE_DIR) + "/../shared/data/" + name;
}

std::vector<double> numbersOf(const nlohmann::json& array) {
  return array.get<std::vector<double>>();
}

std::string commaList(const std::vector<double>& numbers, double factor) {
  std::ostringstream text;
  text << std::setprecision(17);
  for (std::size_t i = 0; i < numbers.size(); ++i)
    text << (i == 0 ? "" : ",") << numbers[i] * factor;
  return text.str();
}

std::vector<std::vector<std::string>> csvRows(const std::string& text) {
  std::vector<std::vector<std::string>> rows;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || line.front() == '#') continue;
    std::istringstream cells(line + ",");
    rows.emplace_back();
    for (std::string cell; std::getline(cells, cell, ',');) rows.back().push_back(cell);
  }
  return rows;
}

}  // namespace helix_arm::test
