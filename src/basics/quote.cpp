#include "quote.hpp"

#include <array>

namespace helix_arm::basics {
namespace {

// A character of a text; of no bytes that are UTF-8, the first byte alone.
struct Character {
  std::size_t size = 1;
  char32_t code = 0;
  bool is_utf8 = false;
};

Character characterAt(std::string_view text, std::size_t at) {
  const auto byte = [&](std::size_t i) -> unsigned {
    return i < text.size() ? static_cast<unsigned char>(text[i]) : 0U;
  };
  const unsigned first = byte(at);
  if (first < 0x80U) return {1, first, true};
  const std::size_t size = first >= 0xF0U ? 4 : first >= 0xE0U ? 3 : 2;
  if (first < 0xC2U || first > 0xF4U) return {1, first, false};
  char32_t code = first & (0x7FU >> size);
  for (std::size_t i = 1; i < size; ++i) {
    if ((byte(at + i) & 0xC0U) != 0x80U) return {1, first, false};
    code = code << 6U | (byte(at + i) & 0x3FU);
  }
  // Neither longer than need be, nor half of a pair of UTF-16, nor beyond Unicode.
  constexpr std::array<char32_t, 5> kLeast = {0, 0, 0x80, 0x800, 0x10000};
  const bool sound = code >= kLeast[size] && code <= 0x10FFFF && (code < 0xD800 || code > 0xDFFF);
  return sound ? Character{size, code, true} : Character{1, first, false};
}

bool controls(char32_t code) {
  const auto within = [code](char32_t first, char32_t last) {
    return first <= code && code <= last;
  };
  return code < 0x20 || within(0x7F, 0x9F) ||               // C0, DEL, C1
         within(0x2028, 0x2029) ||                          // line and paragraph separator
         code == 0x061C || within(0x200E, 0x200F) ||        // marks of direction,
         within(0x202A, 0x202E) || within(0x2066, 0x2069);  // embeddings, overrides, isolates
}

void appendHexadecimal(char32_t value, int digits, std::string& out) {
  for (int shift = 4 * (digits - 1); shift >= 0; shift -= 4) {
    out += "0123456789abcdef"[value >> static_cast<unsigned>(shift) & 0xFU];
  }
}

std::string escaped(std::string_view text, bool keeps_newlines) {
  std::string out;
  out.reserve(text.size());
  for (std::size_t at = 0; at < text.size();) {
    const Character character = characterAt(text, at);
    const bool stays = character.is_utf8 && !controls(character.code);
    if (stays || (keeps_newlines && character.code == '\n')) {
      out += text.substr(at, character.size);
    } else {
      const bool small = character.code <= 0xFF;
      out += small ? "\\x" : "\\u";
      appendHexadecimal(character.code, small ? 2 : 4, out);
    }
    at += character.size;
  }
  return out;
}

}  // namespace

std::string quoted(const std::string& text, std::size_t most) {
  std::string out = text.substr(0, most);
  for (char& c : out) {
    if (c < ' ' || c > '~') c = '?';
  }
  return text.size() > most ? out + "..." : out;
}

std::string printable(std::string_view line) { return escaped(line, false); }
std::string printableLines(std::string_view text) { return escaped(text, true); }

}  // namespace helix_arm::basics
