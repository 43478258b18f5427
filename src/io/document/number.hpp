#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace helix_arm::io {

/// Parses a finite number, independent of the locale: accepts "-1.5e-3", refuses "1.5 kPa", "nan"
/// and "0x10".
std::optional<double> parseNumber(std::string_view text);

/// The shortest decimal that reads back as the same number.
std::string formatNumber(double value);

/// A text as a YAML scalar of one line, quoted where YAML would read it otherwise.
std::string yamlText(const std::string& text);

/// Numbers as a list for messages: "1, 2, 5"; of more than 20, the first 20 and the number of the
/// others.
std::string listOf(const std::vector<int>& numbers);

/// Converts kilopascals of files and command lines to pascals. Used everywhere, so that equal kPa
/// give equal Pa and a pressure at its limit stays inside.
constexpr double pascals(double kpa) { return kpa * 1e3; }

/// Inverse of pascals(); the nearest number if there is no exact one.
double kilopascals(double pa);

}  // namespace helix_arm::io
