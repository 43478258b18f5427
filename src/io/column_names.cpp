#include "column_names.hpp"

#include <algorithm>
#include <iterator>
#include <regex>

namespace helix_arm::io {
namespace {

const char* const kNames[] = {"capture", "tag",   "curvature_rad", "pressure_kpa", "length_m",
                              "x_m",     "y_m",   "z_m",           "qx",           "qy",
                              "qz",      "qw",    "x1_px",         "y1_px",        "x2_px",
                              "y2_px",   "x3_px", "y3_px",         "x4_px",        "y4_px",
                              "time_s"};

// pressure_1_kpa, pressure_999_pa, and in units that no table has: pressure_1_psi
bool isPressure(const std::string& name) {
  static const std::regex form("pressure_[0-9]{1,3}_([km]?pa|m?bar|psi)");
  return std::regex_match(name, form);
}

}  // namespace

std::string columnText(const std::vector<std::string>& columns, std::size_t index) {
  const std::string& name = columns[index];
  const bool ours =
      isPressure(name) || std::find(std::begin(kNames), std::end(kNames), name) != std::end(kNames);
  return ours ? name : "column " + std::to_string(index + 1);
}

}  // namespace helix_arm::io
