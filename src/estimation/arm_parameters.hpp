#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "helix_arm/estimation/arm_filter.hpp"
#include "helix_arm/statics/correction.hpp"

namespace helix_arm::estimation {

/// The parameters theta of an ArmFilter: logarithms of factors on the stiffness ratios that an arm
/// has, on K_eps under load, and on its lengths; one length scale per actuator, or one per section
/// of an arm with many.
class ArmParameters {
 public:
  ArmParameters(const statics::ArmModel& model, const ArmFilterOptions& options);

  int count() const { return static_cast<int>(names_.size()); }
  /// The first ones are on the stiffness; the others are length scales.
  int stiffnessCount() const { return static_cast<int>(stiffness_.size()); }
  const std::vector<std::string>& names() const { return names_; }
  const Eigen::VectorXd& deviations() const { return deviations_; }
  /// (stiffnessCount())^2; length scales are not correlated with anything.
  const Eigen::MatrixXd& stiffnessCorrelation() const { return correlation_; }
  /// First actuator of a length scale, and the first one after it.
  struct Span {
    int begin, end;
  };
  Span actuatorsOf(int parameter) const {
    return spans_[static_cast<std::size_t>(parameter - stiffnessCount())];
  }

  /// Sets the factors of a correction; its offset stays.
  void apply(const Eigen::VectorXd& theta, statics::Correction& correction) const;

 private:
  enum class Entry { kGamma, kKappa, kTau, kEps };  // in the order of the options' correlation
  void add(Entry entry, const char* name, double deviation);
  void addLengths(Span span, const std::string& name, double deviation);

  std::vector<Entry> stiffness_;
  std::vector<Span> spans_;
  std::vector<std::string> names_;
  Eigen::VectorXd deviations_;
  Eigen::MatrixXd correlation_;
};

}  // namespace helix_arm::estimation
