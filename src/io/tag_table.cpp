#include "tag_table.hpp"

#include <cmath>

#include "helix_arm/io/number.hpp"

namespace helix_arm::io {
namespace {

constexpr double kMostNumber = 1e9;

}  // namespace

int TagRow::number(const std::string& column) const {
  const double value = (*this)[column];
  if (value >= 0 && value <= kMostNumber && value == std::floor(value)) {
    return static_cast<int>(value);
  }
  faults.add(line(), column + " is not a whole number from 0 to " + formatNumber(kMostNumber));
  return -1;
}

void requireTagColumns(const DataSet& data, const std::vector<std::string>& columns) {
  std::string missing, expected = "capture, pressure_1_kpa .., tag";
  const auto look = [&data, &missing](const std::string& column) {
    if (data.find(column) < 0) missing += (missing.empty() ? "" : ", ") + column;
  };
  look("capture");
  look("tag");
  for (const std::string& column : columns) {
    look(column);
    expected += ", " + column;
  }
  if (missing.empty()) return;
  FaultList faults(data.path);
  faults.add(0, "has no column " + missing + "; expected " + expected);
  faults.throwIfAny();
}

}  // namespace helix_arm::io
