#pragma once

#include <string>

#include <gtest/gtest.h>

namespace helix_arm::test {

/// Whether a text holds the words; a failure shows both.
inline ::testing::AssertionResult has(const std::string& text, const std::string& words) {
  if (text.find(words) != std::string::npos) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << "'" << words << "' is not in: " << text;
}

}  // namespace helix_arm::test
