#pragma once

#include <cstdio>
#include <string>

namespace helix_arm::basics {

/// A text as printf() writes it.
template <class... Values>
std::string format(const char* pattern, Values... values) {
  std::string text(static_cast<std::size_t>(std::snprintf(nullptr, 0, pattern, values...)), '\0');
  std::snprintf(text.data(), text.size() + 1, pattern, values...);
  return text;
}

/// Words as a list: "a, b, c".
template <class Words>
std::string joined(const Words& words, const char* between = ", ") {
  std::string text;
  for (const auto& word : words) {
    if (!text.empty()) text += between;
    text += word;
  }
  return text;
}

}  // namespace helix_arm::basics
