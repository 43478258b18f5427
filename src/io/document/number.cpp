#include "helix_arm/io/number.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <locale>
#include <sstream>

namespace helix_arm::io {

std::optional<double> parseNumber(const std::string& text) {
  // Constructing a stream takes longer than reading a number, and tables have millions of them.
  thread_local std::istringstream stream;
  stream.imbue(std::locale::classic());
  stream.clear();
  stream.str(text);
  double value = 0.0;
  if (!(stream >> std::noskipws >> value) ||
      stream.peek() != std::istringstream::traits_type::eof()) {
    return std::nullopt;
  }
  if (!std::isfinite(value)) return std::nullopt;
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
  constexpr int kAlwaysEnough = std::numeric_limits<double>::max_digits10;
  for (int digits = std::numeric_limits<double>::digits10;; ++digits) {
    std::ostringstream stream;
    stream.imbue(std::locale::classic());
    stream.precision(digits);
    stream << value;
    if (digits == kAlwaysEnough || parseNumber(stream.str()) == value) return stream.str();
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
