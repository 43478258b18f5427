#pragma once

#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/scene.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {

/// A rule of the schema, broken by replacing one text by another.
struct BrokenRule {
  const char* from;
  const char* to;
  std::vector<std::string> faults;  ///< all of them, no more
};

/// What loading says, without the path of the file; empty when it says nothing.
inline std::vector<std::string> faultsOf(const std::string& text,
                                         const std::vector<io::Override>& overrides = {}) {
  const TemporaryFile file(text);
  std::vector<std::string> faults;
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

}  // namespace helix_arm::test
