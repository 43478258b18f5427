#pragma once

#include <optional>
#include <string>
#include <vector>

namespace helix_arm::io {

/// The finite number that a text spells, whatever the locale: "-1.5e-3", but not "1.5 kPa", "nan"
/// or "0x10".
std::optional<double> parseNumber(const std::string& text);

/// The shortest decimal that reads back as the same number.
std::string formatNumber(double value);

/// Numbers as a message lists them: "1, 2, 5", of many the first 20 and how many more there are.
std::string listOf(const std::vector<int>& numbers);

/// The one place where kilopascals of files and command lines become pascals: equal kPa give equal
/// Pa, so a pressure at its limit stays inside.
constexpr double pascals(double kpa) { return kpa * 1e3; }

/// The kilopascals that pascals() turns into this pressure; where no number does, the nearest one.
double kilopascals(double pa);

}  // namespace helix_arm::io
