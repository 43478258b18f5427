#pragma once

#include <chrono>
#include <functional>

#include <gtest/gtest.h>

#include "helix_arm/regulator/driver.hpp"

namespace helix_arm::test {

/// What a call of a driver comes to.
enum class End { kDone, kBadReply, kLinkError };

inline End endOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const regulator::BadReply& error) {
    EXPECT_STRNE(error.what(), "");
    return End::kBadReply;
  } catch (const regulator::LinkError& error) {
    EXPECT_STRNE(error.what(), "");
    return End::kLinkError;
  }
  return End::kDone;
}

inline double secondsOf(const std::function<void()>& call) {
  const auto begin = std::chrono::steady_clock::now();
  call();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// Far above a timeout on any machine, and below what would hold up a thread for good [s].
inline constexpr double kBounded = 60;

}  // namespace helix_arm::test
