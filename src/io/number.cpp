#include "helix_arm/io/number.hpp"

#include <cmath>
#include <limits>
#include <locale>
#include <sstream>

namespace helix_arm::io {

std::optional<double> parseNumber(const std::string& text) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  double value = 0.0;
  if (!(stream >> std::noskipws >> value) ||
      stream.peek() != std::istringstream::traits_type::eof()) {
    return std::nullopt;
  }
  if (!std::isfinite(value)) return std::nullopt;
  return value;
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

}  // namespace helix_arm::io
