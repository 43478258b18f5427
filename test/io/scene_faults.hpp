#pragma once

#include <algorithm>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/scene.hpp"
#include "support/scene_text.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {

/// The scene of a text.
inline io::Scene sceneOf(const std::string& text, const std::vector<io::Override>& overrides = {}) {
  return io::loadScene(TemporaryFile(text).path(), overrides);
}

/// A shipped scene.
inline io::Scene shippedScene(const std::string& name,
                              const std::vector<io::Override>& overrides = {}) {
  return io::loadScene(HELIX_ARM_SOURCE_DIR "/config/scenes/" + name + ".yaml", overrides);
}

using Faults = std::vector<std::string>;

/// What loading says, without the path of the file; empty when it says nothing.
inline Faults faultsOf(const std::string& text, const std::vector<io::Override>& overrides = {}) {
  const TemporaryFile file(text);
  Faults faults;
  try {
    io::loadScene(file.path(), overrides);
  } catch (const io::DocumentError& error) {
    std::istringstream lines(error.what());
    for (std::string line; std::getline(lines, line);) {
      EXPECT_EQ(line.compare(0, file.path().size(), file.path()), 0) << line;
      faults.push_back(line.substr(file.path().size()));
    }
  }
  return faults;
}

/// A rule of a document, broken by replacing one text by another.
struct BrokenRule {
  const char* from;
  const char* to;
  Faults faults;  ///< all of them, no more
};

/// A rule of a document, broken by another value of a key: one fault, in the line of that key.
struct BrokenValue {
  const char* map;       ///< that holds the key, with a dot at its end
  const char* given;     ///< "key: value" of the document
  const char* value;     ///< in place of that value, or another key with its value
  const char* expected;  ///< or, from a blank, dot or bracket on, all that is said of the key
};

/// The key that a text begins with; empty where it begins with none.
inline std::string keyIn(const std::string& text) {
  const std::size_t end = text.find_first_not_of("abcdefghijklmnopqrstuvwxyzK_0123456789");
  return end != std::string::npos && text.compare(end, 2, ": ") == 0 ? text.substr(0, end) : "";
}

/// What the loader of a file says of a text with this rule broken.
template <class FaultsOf>
void expectFault(const std::string& text, const BrokenRule& rule, const FaultsOf& faults_of,
                 const std::string& /*file*/) {
  EXPECT_EQ(faults_of(replaced(text, rule.from, rule.to)), rule.faults) << rule.to;
}

template <class FaultsOf>
void expectFault(const std::string& text, const BrokenValue& rule, const FaultsOf& faults_of,
                 const std::string& file) {
  const std::string given = rule.given, value = rule.value, expected = rule.expected;
  const bool is_other = !keyIn(value).empty(), is_all = expected.find_first_of(" .[") == 0;
  const std::string to = is_other ? value : keyIn(given) + ": " + value, key = keyIn(to);
  const std::string changed = replaced(text, given, to);  // throws where there is no `given`
  const auto line = 1 + std::count(text.begin(), text.begin() + text.find(given), '\n');
  const std::string said =
      is_all ? expected : " is " + to.substr(key.size() + 2) + "; expected " + expected;
  EXPECT_EQ(faults_of(changed),
            Faults{file + ":" + std::to_string(line) + " " + rule.map + key + said})
      << to;
}

/// Breaks each of these rules of a text that breaks none; `file` is its name in the faults.
template <class Rules, class FaultsOf>
void expectFaults(const std::string& text, const Rules& rules, const FaultsOf& faults_of,
                  const std::string& file) {
  ASSERT_EQ(faults_of(text), Faults());
  for (const auto& rule : rules) expectFault(text, rule, faults_of, file);
}

/// The same of a scene.
template <class Rules>
void expectFaults(const std::string& scene, const Rules& rules) {
  expectFaults(
      scene, rules, [](const std::string& text) { return faultsOf(text); }, "");
}

}  // namespace helix_arm::test
