#include "helix_arm/statics/input_samples.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <random>

#include "helix_arm/basics/fraction.hpp"

namespace helix_arm::statics {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kNoMotion = 1e-9;  // of a singular value, relative to the largest

// The combinations of a section's inputs that move it, orthonormal (n x rank).
MatrixXd motionsOf(const model::Arm& arm, const VectorXd& range, int k) {
  MatrixXd map = arm.equilibrium(k).map;
  map *= range.segment(arm.firstActuator(k), map.cols()).asDiagonal();
  map.topRows<lie::SE3::kSpace>() /= arm.freeLength(k);
  const Eigen::JacobiSVD<MatrixXd> svd(map, Eigen::ComputeThinV);
  const VectorXd& values = svd.singularValues();
  return svd.matrixV().leftCols((values.array() > kNoMotion * values[0]).count());
}

}  // namespace

std::vector<VectorXd> sampleInputs(const model::Arm& arm, int corners, int inner) {
  const int n = arm.actuatorCount(), sections = arm.sectionCount();
  const VectorXd range = arm.lengths(arm.inputAt(0.0)) - arm.lengths(arm.inputAt(1.0));
  std::vector<MatrixXd> motions;
  int most = 0;
  for (int k = 0; k < sections; ++k) {
    motions.push_back(motionsOf(arm, range, k));
    most = std::max(most, static_cast<int>(motions.back().cols()));
  }
  std::vector<VectorXd> out = {arm.inputAt(0.0), arm.inputAt(1.0)};
  VectorXd fraction(n);
  const auto toCorner = [&](int k, const VectorXd& direction) {
    fraction.segment(arm.firstActuator(k), direction.size()) =
        (direction.array() > 0).cast<double>();
  };
  for (int j = 0; j < most; ++j) {
    for (const double sign : {1.0, -1.0}) {
      fraction.setZero();
      for (int k = 0; k < sections; ++k) {
        if (j < motions[k].cols()) toCorner(k, sign * motions[k].col(j));
      }
      out.push_back(arm.inputAt(fraction));
      for (int k = 0; k < sections && sections > 1; ++k) {
        fraction.setZero();
        if (j >= motions[k].cols()) continue;
        toCorner(k, sign * motions[k].col(j));
        out.push_back(arm.inputAt(fraction));
      }
    }
  }
  std::mt19937_64 generator(20240229);
  for (int sample = 0; sample < corners; ++sample) {
    for (int k = 0; k < sections; ++k) {
      VectorXd share(motions[k].cols());
      for (double& one : share) one = 2.0 * basics::fractionOf(generator()) - 1.0;
      toCorner(k, motions[k] * share);
    }
    out.push_back(arm.inputAt(fraction));
  }
  for (int sample = 0; sample < inner; ++sample) {
    for (double& one : fraction) one = basics::fractionOf(generator());
    out.push_back(arm.inputAt(fraction));
  }
  return out;
}

}  // namespace helix_arm::statics
