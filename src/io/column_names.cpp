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

const char* const kPressureUnits[] = {"_kpa", "_pa", "_psi", "_bar", "_mbar", "_mpa"};

// pressure_, up to three digits, and a unit.
bool isPressure(const std::string& name) {
  constexpr std::size_t kMostDigits = 3;
  const std::string prefix = "pressure_";
  if (name.compare(0, prefix.size(), prefix) != 0) return false;
  const std::size_t end = std::min(name.find('_', prefix.size()), name.size());
  const auto place = [&name](std::size_t i) { return name.begin() + static_cast<long>(i); };
  return end > prefix.size() && end - prefix.size() <= kMostDigits &&
         std::all_of(place(prefix.size()), place(end),
                     [](char c) { return c >= '0' && c <= '9'; }) &&
         std::find(std::begin(kPressureUnits), std::end(kPressureUnits), name.substr(end)) !=
             std::end(kPressureUnits);
}

}  // namespace

std::string columnText(const std::vector<std::string>& columns, std::size_t index) {
  const std::string& name = columns[index];
  const bool ours =
      isPressure(name) || std::find(std::begin(kNames), std::end(kNames), name) != std::end(kNames);
  return ours ? name : "column " + std::to_string(index + 1);
}

}  // namespace helix_arm::io
