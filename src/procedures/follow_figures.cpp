#include "follow_figures.hpp"

#include <algorithm>
#include <cmath>

namespace helix_arm::procedures {
namespace {

constexpr double kSettledWithin = 0.002;  // [m]
constexpr double kSettledPart = 0.05;     // of the step

double errorOf(const FollowRow& row) { return (row.true_tip - *row.wanted).norm(); }

using Rows = std::vector<FollowRow>::const_iterator;

double rms(Rows begin, Rows end) {
  double sum = 0.0;
  for (Rows row = begin; row != end; ++row) sum += errorOf(*row) * errorOf(*row);
  return std::sqrt(sum / static_cast<double>(end - begin));
}

// Time from the first row until the error stays within the bound; absent if it never does.
std::optional<double> settleTime(Rows begin, Rows end) {
  const double step = errorOf(*begin);
  const double bound = kSettledWithin + kSettledPart * step;
  Rows last_outside = end;
  for (Rows row = begin; row != end; ++row) {
    if (errorOf(*row) > bound) last_outside = row;
  }
  if (last_outside == end) return 0.0;
  if (last_outside + 1 == end) return std::nullopt;
  return (last_outside + 1)->time - begin->time;
}

}  // namespace

FollowFigures tipFigures(const std::vector<FollowRow>& rows, int tips) {
  FollowFigures out;
  const auto count = static_cast<std::ptrdiff_t>(rows.size());
  for (int k = 0; k < tips; ++k) {
    const Rows begin = rows.begin() + count * k / tips, end = rows.begin() + count * (k + 1) / tips;
    out.settle.push_back(settleTime(begin, end));
    const double from = (end - 1)->time - kLeastTipTime;
    const Rows steady =
        std::find_if(begin, end, [from](const FollowRow& row) { return row.time >= from; });
    out.steady_rms.push_back(rms(steady, end));
    out.unreachable.push_back((end - 1)->unreachable);
  }
  return out;
}

FollowFigures pathFigures(const std::vector<FollowRow>& rows, double duration) {
  FollowFigures out;
  const Rows begin = std::find_if(rows.begin(), rows.end(), [](const FollowRow& row) {
    return row.path_time && *row.path_time >= 0;
  });
  const Rows end = std::find_if(begin, rows.end(), [duration](const FollowRow& row) {
    return !row.path_time || *row.path_time > duration;
  });
  if (begin == end) return out;
  out.path_rms = rms(begin, end);
  double most = 0.0;
  for (Rows row = begin; row != end; ++row) most = std::max(most, errorOf(*row));
  out.path_max = most;
  return out;
}

}  // namespace helix_arm::procedures
