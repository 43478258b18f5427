#pragma once

#include <Eigen/Core>
#include <array>

#include "gauss_rule.hpp"
#include "helix_arm/lie/se3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/statics/loaded.hpp"

/// The fixed-point iteration of the loaded tier: its acceleration, and how it answers to changes.
namespace helix_arm::statics {

/// Maximum number of elements: parts of an arm between section ends and point loads.
inline constexpr int kMaxElements = model::kMaxSections + kMaxInnerPoints;
/// Maximum number of Gauss points and of unknowns.
inline constexpr int kMaxNodes = GaussRule::kMostNodes * kMaxElements;
inline constexpr int kMaxRates = lie::SE3::kDof * kMaxNodes;

/// Krylov space (Arnoldi) of a linear map of vectors of `size` entries, of a start vector with
/// components in all entries. Allocates nothing.
class KrylovSpace {
 public:
  /// Real parts of eigenvalues.
  struct Range {
    double least, largest;
  };

  /// @param size  1 .. kMaxRates.
  explicit KrylovSpace(int size);

  /// Whether all of the space is known, or as much of it as the eigenvalues need.
  bool complete() const { return known_ == count_; }
  /// (size) unit vector whose image is to be added next.
  const auto& motion() const { return basis_[known_]; }
  void add(const Eigen::Ref<const Eigen::VectorXd>& image);
  /// Eigenvalues of the map in the complete space; the largest is infinite if they are not finite.
  Range eigenvalues() const;

 private:
  static constexpr int kDimensions = 8;
  // Length beyond the known space below which an image lies in it.
  static constexpr double kInside = 1e-6;

  int count_, known_ = 0;
  std::array<Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxRates, 1>,
             kDimensions + 1>
      basis_;
  Eigen::Matrix<double, kDimensions + 1, kDimensions> H_;  // the map, seen in the basis
};

/// Anderson's acceleration of a fixed-point iteration x = F(x): the next x is the combination of
/// the last values F(x) whose changes F(x) - x cancel best (least squares). x has at most kMaxRates
/// entries; nothing is allocated.
class Anderson {
 public:
  using Values = Eigen::Ref<Eigen::VectorXd>;

  /// @param weight  (n) weight of each entry in the least squares.
  explicit Anderson(const Eigen::Ref<const Eigen::VectorXd>& weight);

  /// Adds x and F(x), (n) each, and replaces x by the next iterate.
  /// @return the largest entry of the weighted change F(x) - x, for the old x.
  double advance(Values x, const Eigen::Ref<const Eigen::VectorXd>& answer);

 private:
  static constexpr int kDepth = 5;
  static constexpr double kRidge = 1e-12;  // relative to memories of unit length; for nearly
                                           // parallel ones
  using Stack = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxRates, 1>;
  using Memory = Eigen::Matrix<double, Eigen::Dynamic, kDepth, Eigen::ColMajor, kMaxRates, kDepth>;

  Stack weight_, last_answer_, last_change_;
  Memory changes_, answers_;                    // differences of consecutive values
  Eigen::Matrix<double, kDepth, kDepth> gram_;  // of the changes
  int calls_ = 0;
};

}  // namespace helix_arm::statics
