#include "inverse_starts.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <random>

#include "helix_arm/basics/fraction.hpp"

namespace helix_arm::statics {
namespace {

constexpr int kSamples = 1024;
constexpr int kNearestStarts = 12;  // of all
constexpr int kCornerStarts =
    10;  // then of the corners of the limits; later ones are spread over all
constexpr int kMaxActuatorsForCorners = 6;
constexpr std::uint64_t kGeneratorSeed = 20240229;
constexpr int kStride = 97;  // between the later starts; coprime to their number

}  // namespace

InverseStarts::InverseStarts(const model::Arm& arm, const ArmModel* loaded, const LengthBox& box) {
  const int n = box.size();
  corners_ = n <= kMaxActuatorsForCorners ? 1 << n : 0;
  lengths_.resize(n, kSamples + corners_);
  std::mt19937_64 generator(kGeneratorSeed);
  for (int s = 0; s < lengths_.cols(); ++s) {
    for (int i = 0; i < n; ++i) {
      const bool corner = s < corners_;
      const double fraction = corner ? (s >> i) & 1 : basics::fractionOf(generator());
      lengths_(i, s) = box.lower()[i] + fraction * (box.upper()[i] - box.lower()[i]);
    }
    // Starts are ranked with the loaded tier, which is sufficient even for the exact one.
    const bool by_load = loaded != nullptr && loaded->choice().setting.tier == Tier::kLoaded;
    tips_.push_back(by_load ? loaded->tipOfLengths(lengths_.col(s)).tip
                            : arm.tipOfLengths(lengths_.col(s)));
  }
  used_.resize(lengths_.cols());
}

// The start among the first `count` unused ones whose tip is nearest to the target; -1 if there is
// none.
int InverseStarts::nearest(int count, const InverseTask& task) const noexcept {
  int choice = -1;
  double least = std::numeric_limits<double>::infinity();
  for (int s = 0; s < count; ++s) {
    if (used_[s]) continue;
    const double error = task.squaredErrorOfTip(tips_[s]);
    if (error < least) {
      least = error;
      choice = s;
    }
  }
  return choice;
}

Eigen::MatrixXd::ConstColXpr InverseStarts::next(int number, const InverseTask& task) noexcept {
  if (number == 0) std::fill(used_.begin(), used_.end(), 0);
  const int count = static_cast<int>(lengths_.cols());
  int choice = -1;
  if (number < kNearestStarts) {
    choice = nearest(count, task);
  } else if (number < kNearestStarts + kCornerStarts) {
    choice = nearest(corners_, task);
  }
  if (choice < 0) choice = std::max(0, number - kNearestStarts) * kStride % count;
  used_[choice] = 1;
  return static_cast<const Eigen::MatrixXd&>(lengths_).col(choice);
}

}  // namespace helix_arm::statics
