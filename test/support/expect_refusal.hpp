#pragma once

#include <initializer_list>

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

/// Values that break one rule each, made from one that breaks none, and the words that say so.
template <class Value>
struct Spoilt {
  void (*spoil)(Value&);
  const char* words;
};
template <class Value, class Take>
void expectRefusals(const Value& sound, const Take& take,
                    std::initializer_list<Spoilt<Value>> cases) {
  EXPECT_NO_THROW(take(sound));
  for (const Spoilt<Value>& one : cases) {
    Value bad = sound;
    one.spoil(bad);
    expectRefusal(one.words, [&] { take(bad); });
  }
}

}  // namespace helix_arm::test
