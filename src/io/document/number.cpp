#include "number.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

namespace helix_arm::io {

std::optional<double> parseNumber(std::string_view text) {
  // std::from_chars takes no plus sign.
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  const char* const end = text.data() + text.size();
  double value = 0.0;
  const auto [last, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || last != end || !std::isfinite(value)) return std::nullopt;
  return value;
}

double kilopascals(double pa) {
  const double kpa = pa / 1e3;
  for (const double direction : {-1.0, 1.0}) {
    const double next = std::nextafter(kpa, direction * std::numeric_limits<double>::infinity());
    if (pascals(kpa) != pa && pascals(next) == pa) return next;
  }
  return kpa;
}

std::string formatNumber(double value) {
  char text[32];
  for (int digits = std::numeric_limits<double>::digits10;; ++digits) {
    const char* const end =
        std::to_chars(text, text + sizeof text, value, std::chars_format::general, digits).ptr;
    const std::string_view written(text, static_cast<std::size_t>(end - text));
    const bool exact = parseNumber(written) == value;
    if (exact || digits == std::numeric_limits<double>::max_digits10) return std::string(written);
  }
}

std::string listOf(const std::vector<int>& numbers) {
  constexpr std::size_t kMost = 20;
  std::string list;
  for (std::size_t i = 0; i < std::min(numbers.size(), kMost); ++i) {
    list += (i == 0 ? "" : ", ") + std::to_string(numbers[i]);
  }
  if (numbers.size() > kMost) {
    list += " and " + std::to_string(numbers.size() - kMost) + " more";
  }
  return list;
}

}  // namespace helix_arm::io
