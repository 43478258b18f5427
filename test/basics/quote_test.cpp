#include "helix_arm/basics/quote.hpp"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "helix_arm/basics/requirement.hpp"
#include "support/refusal.hpp"

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

TEST(Printable, TextOfAnyLanguageStaysAsItIs) {
  for (const char* text : {"", "muscle_1 ~ {x}\\", "M\u00fcller \u03b3 \u4e16\u754c \U0001f600",
                           "\u05d0\u05d1 \u0627\u0628", "\u00a0"}) {
    EXPECT_EQ(printable(text), text);
  }
}

TEST(Printable, WhatATerminalObeysBecomesAnEscape) {
  const struct {
    std::string text, line;
  } kCases[] = {{"\x1b]0;x\x07", "\\x1b]0;x\\x07"},
                {"a\rb\tc", "a\\x0db\\x09c"},
                {"a\nerror: b", "a\\x0aerror: b"},
                {std::string("a\0b", 3), "a\\x00b"},
                {"\x7f", "\\x7f"},
                {"\u009b31m", "\\x9b31m"},  // CSI of C1
                {"a\u2028b\u2029", "a\\u2028b\\u2029"},
                {"\u202e\u2066\u200f\u061c", "\\u202e\\u2066\\u200f\\u061c"},
                {"\x9b\xe4", "\\x9b\\xe4"},           // of Latin-1
                {"\xc0\x8a", "\\xc0\\x8a"},           // an overlong newline
                {"\xed\xa0\x80", "\\xed\\xa0\\x80"},  // half of a pair
                {"\xf4\x90\x80\x80", "\\xf4\\x90\\x80\\x80"},
                {"\xe2\x80", "\\xe2\\x80"},
                {"\xe2\x80\u00fc", "\\xe2\\x80\u00fc"}};
  for (const auto& entry : kCases) {
    EXPECT_EQ(printable(entry.text), entry.line);
    EXPECT_EQ(printableLines(entry.text), entry.text == "a\nerror: b" ? entry.text : entry.line);
  }
}

TEST(Printable, OfAnyBytesNoControlCharacterIsLeft) {
  std::mt19937 generator(1);
  std::uniform_int_distribution<int> byte(0, 255);
  for (int i = 0; i < 2000; ++i) {
    std::string text;
    for (int k = 0; k < 200; ++k) text += static_cast<char>(byte(generator));
    const std::string line = printable(text);
    EXPECT_EQ(printable(line), line);
    for (const char c : line) EXPECT_FALSE((c >= 0 && c < ' ') || c == '\x7f');
  }
}

TEST(Requirement, HasTheMessageAndNoSignOfANan) {
  const auto message = [](double value) {
    return test::refusal([&] { requireValue(false, "Arm", "length", value, "a number"); });
  };
  EXPECT_EQ(message(-1.5), "Arm: length is -1.5; expected a number");
  EXPECT_EQ(message(std::nan("")), "Arm: length is nan; expected a number");
  EXPECT_EQ(message(-std::nan("")), "Arm: length is nan; expected a number");
}

}  // namespace
}  // namespace helix_arm::basics
