#include "helix_arm/basics/requirement.hpp"

#include <cmath>

#include <gtest/gtest.h>

namespace helix_arm::basics {
namespace {

TEST(Requirement, HasTheMessageAndNoSignOfANan) {
  const auto message = [](double value) -> std::string {
    try {
      requireValue(false, "Arm", "length", value, "a number");
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(message(-1.5), "Arm: length is -1.5; expected a number");
  EXPECT_EQ(message(std::nan("")), "Arm: length is nan; expected a number");
  EXPECT_EQ(message(-std::nan("")), "Arm: length is nan; expected a number");
}

}  // namespace
}  // namespace helix_arm::basics
