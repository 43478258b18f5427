#pragma once

#include <gtest/gtest.h>

#include "support/refusal.hpp"

namespace helix_arm::test {

/// A call is refused, and the message holds these words.
template <class Exception = std::invalid_argument>
void expectRefusal(const std::string& words, const std::function<void()>& call) {
  const std::string message = refusal<Exception>(call);
  EXPECT_NE(message.find(words), std::string::npos) << message << "\n  expected " << words;
}

}  // namespace helix_arm::test
