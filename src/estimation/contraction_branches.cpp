#include "contraction_branches.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace helix_arm::estimation {
namespace {

// A smaller change of the pressure, relative to the largest one, is noise of the regulator and
// starts no new branch.
constexpr double kLeastMove = 0.01;

// 1 if the pressure had risen before the sample, -1 if it had fallen, 0 before its first change.
std::vector<int> arrivals(const std::vector<double>& pressure, double least_move) {
  std::vector<int> out(pressure.size(), 0);
  for (std::size_t i = 1, last = 0; i < pressure.size(); ++i) {
    const double move = pressure[i] - pressure[last];
    out[i] = out[i - 1];
    if (std::abs(move) <= least_move) continue;
    out[i] = move > 0 ? 1 : -1;
    last = i;
  }
  return out;
}

}  // namespace

std::vector<Branches> branchesOf(const std::vector<LengthSample>& samples) {
  std::vector<double> pressure;
  for (const LengthSample& sample : samples) pressure.push_back(sample.pressure);
  if (pressure.empty()) return {};
  const double least_move = kLeastMove * *std::max_element(pressure.begin(), pressure.end());
  const std::vector<int> before = arrivals(pressure, least_move);
  std::reverse(pressure.begin(), pressure.end());
  std::vector<int> after = arrivals(pressure, least_move);  // in reverse order, a rise is a fall
  std::reverse(after.begin(), after.end());
  std::vector<Branches> out;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    out.push_back({before[i] > 0 || after[i] < 0, before[i] < 0 || after[i] > 0});
  }
  return out;
}

}  // namespace helix_arm::estimation
