#include "column_names.hpp"

#include <algorithm>
#include <iterator>

namespace helix_arm::io {
namespace {

const char* const kNames[] = {"capture", "tag",   "curvature_rad", "pressure_kpa", "length_m",
                              "x_m",     "y_m",   "z_m",           "qx",           "qy",
                              "qz",      "qw",    "x1_px",         "y1_px",        "x2_px",
                              "y2_px",   "x3_px", "y3_px",         "x4_px",        "y4_px",
                              "time_s"};

// pressure_1_kpa to pressure_999_kpa
bool isPressure(const std::string& name) {
  constexpr std::size_t kMostDigits = 3;
  const std::string prefix = "pressure_", suffix = "_kpa";
  if (name.size() <= prefix.size() + suffix.size()) return false;
  const std::size_t digits = name.size() - prefix.size() - suffix.size();
  const auto number = name.begin() + static_cast<long>(prefix.size());
  return digits <= kMostDigits && *number != '0' && name.compare(0, prefix.size(), prefix) == 0 &&
         name.compare(prefix.size() + digits, suffix.size(), suffix) == 0 &&
         std::all_of(number, number + static_cast<long>(digits),
                     [](char c) { return c >= '0' && c <= '9'; });
}

}  // namespace

std::string columnText(const std::vector<std::string>& columns, std::size_t index) {
  const std::string& name = columns[index];
  const bool ours =
      isPressure(name) || std::find(std::begin(kNames), std::end(kNames), name) != std::end(kNames);
  return ours ? name : "column " + std::to_string(index + 1);
}

}  // namespace helix_arm::io
