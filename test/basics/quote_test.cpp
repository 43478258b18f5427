#include "helix_arm/basics/quote.hpp"

#include <gtest/gtest.h>

namespace helix_arm::basics {
namespace {

TEST(Quote, ShortPrintableTextStaysAsItIs) {
  EXPECT_EQ(quoted(""), "");
  EXPECT_EQ(quoted("muscle_1 ~ {x}"), "muscle_1 ~ {x}");
  EXPECT_EQ(quoted(std::string(64, 'a')), std::string(64, 'a'));
}

TEST(Quote, LongTextIsCut) {
  EXPECT_EQ(quoted(std::string(65, 'a')), std::string(64, 'a') + "...");
  EXPECT_EQ(quoted(std::string(2'000'000, 'a')), std::string(64, 'a') + "...");
  EXPECT_EQ(quoted("abcdef", 3), "abc...");
}

TEST(Quote, EveryByteThatATerminalCouldTakeAmissBecomesAQuestionMark) {
  for (int byte = 0; byte < 256; ++byte) {
    const char c = static_cast<char>(byte);
    const bool printable = byte >= 0x20 && byte < 0x7f;
    EXPECT_EQ(quoted(std::string(1, c)), std::string(1, printable ? c : '?')) << byte;
  }
}

}  // namespace
}  // namespace helix_arm::basics
