#pragma once

#include <gtest/gtest.h>

#include "support/has.hpp"
#include "support/refusal.hpp"

namespace helix_arm::test {

/// A call is refused, and the message holds these words.
template <class Exception = std::invalid_argument>
void expectRefusal(const std::string& words, const std::function<void()>& call) {
  const std::string message = refusal<Exception>(call);
  EXPECT_NE(message, "accepted") << "expected " << words;
  EXPECT_TRUE(has(message, words));
}

}  // namespace helix_arm::test
