#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "helix_arm/lie/se3.hpp"
#include "helix_arm/lie/so3.hpp"
#include "helix_arm/model/arm.hpp"
#include "helix_arm/model/taper.hpp"
#include "helix_arm/statics/load.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "statics/loaded/buckling.hpp"

/// Dormand and Prince's pair of order 8 with estimates of order 5 and 3 (Hairer, Norsett, Wanner,
/// Solving Ordinary Differential Equations I, section II.10).
namespace helix_arm::statics::dormand_prince {

inline constexpr int kStages = 12;
/// A stage: its place in the step, and the weights of the stages before it.
struct Stage {
  double node, weights[kStages];
};
inline constexpr Stage kTableau[kStages] = {
    {0.0, {}},
    {0.05260015195876773, {0.05260015195876773}},
    {0.0789002279381516, {0.0197250569845379, 0.0591751709536137}},
    {0.1183503419072274, {0.02958758547680685, 0, 0.08876275643042054}},
    {0.2816496580927726, {0.2413651341592667, 0, -0.8845494793282861, 0.924834003261792}},
    {0.3333333333333333, {0.037037037037037035, 0, 0, 0.17082860872947386, 0.12546768756682242}},
    {0.25, {0.037109375, 0, 0, 0.17025221101954405, 0.06021653898045596, -0.017578125}},
    {0.3076923076923077,
     {0.03709200011850479, 0, 0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
      0.008273789163814023}},
    {0.6512820512820513,
     {0.6241109587160757, 0, 0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
      20.154067550477894, -43.48988418106996}},
    {0.6,
     {0.47766253643826434, 0, 0, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
      15.279233632882423, -33.28821096898486, -0.020331201708508627}},
    {0.8571428571428571,
     {-0.9371424300859873, 0, 0, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
      -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196}},
    {1.0,
     {2.273310147516538, 0, 0, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
      27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303,
      0.6433927460157636}}};
/// Weights of all stages in the step and in its estimates.
struct Weights {
  double step, error5, error3;
};
inline constexpr Weights kWeights[kStages] = {
    {0.054293734116568765, 0.01312004499419488, -0.18980075407240762},
    {0, 0, 0},
    {0, 0, 0},
    {0, 0, 0},
    {0, 0, 0},
    {4.450312892752409, -1.2251564463762044, 4.450312892752409},
    {1.8915178993145003, -0.4957589496572502, 1.8915178993145003},
    {-5.801203960010585, 1.6643771824549864, -5.801203960010585},
    {0.3111643669578199, -0.35032884874997366, -0.4226823213237919},
    {-0.1521609496625161, 0.3341791187130175, -0.1521609496625161},
    {0.20136540080403034, 0.08192320648511571, 0.20136540080403034},
    {0.04471061572777259, -0.022355307863886294, 0.02265179219836082}};

}  // namespace helix_arm::statics::dormand_prince

namespace helix_arm::statics {

/// A point load; force and moment in the base frame.
struct Pull {
  Eigen::Vector3d offset, force, moment;
};

/// Part of the arm between two shooting nodes. The point loads at its end act on it.
struct Segment {
  int section = 0;
  double begin = 0.0, end = 1.0;  // s along the section
  Eigen::Vector3d force;          // at the end, including all loads beyond [N]
  Eigen::Vector3d weight;         // per unit s [N]
  std::vector<Pull> pulls;        // at the end
  double growth = 0.0;            // exponent of the error growth along the segment

  Eigen::Vector3d forceAt(double s) const { return force + (end - s) * weight; }
};

struct SectionLaw {
  lie::Matrix6 C;  // twist over the section per body wrench; of a tapered one, the mean
  model::Equilibrium<lie::SE3>::Basis null_space;
  std::shared_ptr<const model::TaperOf<lie::SE3>> taper;  // null if the section is not tapered
  double per_K = 0.0;                                     // l / K_eps
};

/// The differential equations of frame and moment along a loaded rod, g = g* + C [n; m] in the body
/// frame, X' = X g, m' = m x w + n x v, and their integration. The state: the quaternion (x y z w)
/// and the body moment; then either the position and the integral of the angular strain, or
/// kColumns columns of the flow's derivative.
template <int kColumns>
struct Flow {
  static constexpr int kSize = 7 + (kColumns == 0 ? 6 : 6 * kColumns);
  using State = Eigen::Matrix<double, kSize, 1>;

  const SectionLaw& law;
  const Segment& segment;
  lie::Vector6 unloaded;                               // of a tapered section, the mean
  std::optional<model::TaperTwist<lie::SE3>> profile;  // of a tapered section
  lie::Matrix6 compliance;                             // twist per body wrench, without taper
  double share;                                        // fraction of the load
  double size;                                         // of the arm [m]
  double moment_unit;                                  // [N m]
  double tolerance;

  static Eigen::Matrix3d rotation(const State& y) {
    const double qx = y[0], qy = y[1], qz = y[2], qw = y[3];
    const double f = 2.0 / y.template head<4>().squaredNorm();
    Eigen::Matrix3d R;
    R << 1 - f * (qy * qy + qz * qz), f * (qx * qy - qw * qz), f * (qx * qz + qw * qy),  //
        f * (qx * qy + qw * qz), 1 - f * (qx * qx + qz * qz), f * (qy * qz - qw * qx),   //
        f * (qx * qz - qw * qy), f * (qy * qz + qw * qx), 1 - f * (qx * qx + qy * qy);
    return R;
  }

  lie::Vector6 wrench(double s, const State& y) const {
    lie::Vector6 w;
    w << rotation(y).transpose() * (share * segment.forceAt(s)), y.template segment<3>(4);
    return w;
  }

  State operator()(double s, const State& y) const {
    State dy;
    const Eigen::Matrix3d R = rotation(y);
    const Eigen::Vector3d n = R.transpose() * (share * segment.forceAt(s)),
                          m = y.template segment<3>(4);
    lie::Matrix6 C_here;
    if (profile) C_here = law.per_K * law.taper->complianceAt(s);
    const lie::Matrix6& C = profile ? C_here : compliance;
    const lie::Vector6 g =
        (profile ? profile->at(s) : unloaded) + C.leftCols<3>() * n + C.rightCols<3>() * m;
    const Eigen::Vector3d v = g.head<3>(), w = g.tail<3>();
    const Eigen::Vector3d u = y.template head<3>();
    dy.template head<3>() = 0.5 * (y[3] * w + u.cross(w));
    dy[3] = -0.5 * u.dot(w);
    dy.template segment<3>(4) = m.cross(w) + n.cross(v);
    if constexpr (kColumns == 0) {
      dy.template segment<3>(7) = R * v;
      dy.template segment<3>(10) = w;
    } else {
      using Columns = Eigen::Matrix<double, 6, kColumns>;
      using Half = Eigen::Matrix<double, 3, kColumns>;
      const Eigen::Map<const Columns> d(y.data() + 7);
      Eigen::Map<Columns> dd(dy.data() + 7);
      const Eigen::Matrix3d n_hat = lie::skew(n), w_hat = lie::skew(w);
      const Half dn = n_hat * d.template topRows<3>(), dm = d.template bottomRows<3>();
      const Columns dg = C.leftCols<3>() * dn + C.rightCols<3>() * dm;
      dd.template topRows<3>() = dg.template bottomRows<3>() - w_hat * d.template topRows<3>();
      dd.template bottomRows<3>() = lie::skew(m) * dg.template bottomRows<3>() - w_hat * dm +
                                    n_hat * dg.template topRows<3>() - lie::skew(v) * dn;
    }
    return dy;
  }

  // Squared error of the state, relative to the arm's size and one radian. The derivative is
  // excluded, since it need not be more accurate than the state.
  double squaredError(const State& e) const {
    double sum = 4.0 * e.template head<4>().squaredNorm() +
                 e.template segment<3>(4).squaredNorm() / (moment_unit * moment_unit);
    if constexpr (kColumns == 0) sum += e.template segment<3>(7).squaredNorm() / (size * size);
    return sum;
  }

  // Integrates y from s to end. False if the steps vanish or the numbers overflow.
  bool advance(double s, double end, State& y, double& h) const {
    using namespace dormand_prince;
    std::array<State, kStages> k;
    // Ten times the steps that shapes in equilibrium need.
    const double most_steps =
        200 + 20 * (segment.growth + unloaded.tail<3>().norm() * (segment.end - segment.begin));
    for (int steps = 0; s < end; ++steps) {
      // If the end is almost reached, the rest is one step.
      const bool last = s + h * (1.0 + 1e-10) >= end || end - s <= 1e-14;
      if (steps > most_steps || !(last || s + h > s)) return false;
      const double step = last ? end - s : h;
      k[0] = (*this)(s, y);
      for (int i = 1; i < kStages; ++i) {
        const Stage& stage = kTableau[i];
        State sum = stage.weights[0] * k[0];
        for (int j = 1; j < i; ++j) {
          if (stage.weights[j] != 0) sum += stage.weights[j] * k[j];
        }
        k[i] = (*this)(s + stage.node * step, y + step * sum);
      }
      State next = kWeights[0].step * k[0], error5 = kWeights[0].error5 * k[0],
            error3 = kWeights[0].error3 * k[0];
      for (int i = 5; i < kStages; ++i) {
        next += kWeights[i].step * k[i];
        error5 += kWeights[i].error5 * k[i];
        error3 += kWeights[i].error3 * k[i];
      }
      const double square5 = squaredError(error5), square3 = squaredError(error3);
      const double error =
          square5 == 0 ? 0.0 : step * square5 / std::sqrt(square5 + 0.01 * square3) / tolerance;
      const double factor =
          std::isfinite(error) ? std::clamp(0.9 * std::pow(error + 1e-30, -0.125), 0.2, 6.0) : 0.2;
      if (error <= 1.0) {
        y += step * next;
        y.template head<4>().normalize();
        s = last ? end : s + step;
        // A step that was shortened to reach the end does not reduce the step size.
        h = last ? std::max(h, step * factor) : step * factor;
      } else {
        h = step * std::min(factor, 0.9);
      }
    }
    return y.allFinite();
  }
};

inline constexpr double kGrowth = 2.5;          // e-fold growth of errors that a segment may have
inline constexpr int kMaxSegments = 64;         // per section
inline constexpr double kMostGrowth = 50.0;     // per segment that is counted
inline constexpr int kSteps = 16;               // per cell of a taper
inline constexpr double kLeastMoment = 1e-300;  // unit of moments on an arm without load [N m]

// The last s below `end` at which the taper changes its slope; 0 without any.
inline double lastKnot(const SectionLaw& law, double end) {
  if (!law.taper) return 0.0;
  const int cells = law.taper->cells();
  int cell = static_cast<int>(std::ceil(end * cells)) - 1;
  if (static_cast<double>(cell) / cells >= end) --cell;
  return std::max(0.0, static_cast<double>(cell) / cells);
}

/// A loaded arm as a rod. It is divided into segments at point loads, at the ends of sections, and
/// where errors of the start would grow too much along a segment.
class Rod {
 public:
  /// @param load  valid for the arm. @param tolerance  relative to the arm's size and one radian.
  Rod(const model::Arm& arm, const Load& given, double tolerance)
      : tolerance_(tolerance), links_(arm.links()) {
    const Load load = given.atEnds(links_.get());
    const int sections = arm.sectionCount();
    double bend = 0.0;
    for (int k = 0; k < sections; ++k) {
      const double l = arm.freeLength(k);
      laws_.push_back({complianceOf(arm, load, k), arm.equilibrium(k).null_space, arm.taper(k),
                       l / load.K_eps[k]});
      first_.push_back(arm.firstActuator(k));
      tapered_ = tapered_ || arm.taper(k);
      size_ += l;
      bend += laws_[k].C.bottomRightCorner<3, 3>().norm();
      force_scale_ += load.mass[k] * load.gravity.norm();
    }
    first_.push_back(arm.actuatorCount());
    requireTables(arm, load);
    has_tables_ = readsInputs(arm, &load);
    std::vector<PointLoad> points = load.points;
    std::stable_sort(points.begin(), points.end(), [](const PointLoad& a, const PointLoad& b) {
      return a.section + a.s < b.section + b.s;
    });
    for (const PointLoad& point : points) {
      force_scale_ += load.forceOf(point).norm();
      conservative_ = conservative_ && point.moment.isZero(0);
      moment_scale_ += load.forceOf(point).norm() * point.offset.norm() + point.moment.norm();
    }
    moment_scale_ += force_scale_ * size_;
    moment_unit_ = bend > 0 ? 1.0 / bend : std::max(moment_scale_, kLeastMoment);

    divide(arm, load, std::move(points));
  }

  int sections() const { return static_cast<int>(laws_.size()); }
  /// Null without links.
  const std::shared_ptr<const model::Links>& links() const { return links_; }
  /// The link after segment j; null if the next segment begins where this one ends.
  const lie::SE3* linkAfter(int j) const {
    const Segment& segment = segments_[j];
    return links_ && segment.end == 1.0 ? &(*links_)[segment.section] : nullptr;
  }
  /// From the base to the tip.
  const std::vector<Segment>& segments() const { return segments_; }
  int segmentCount() const { return static_cast<int>(segments_.size()); }

  /// The integrator of segment j; keeps a reference to this rod.
  /// @param unloaded  the arm without load. @param share  fraction of the load.
  template <int kColumns>
  Flow<kColumns> flow(int j, const model::Unloaded& unloaded, double share) const {
    const Segment& segment = segments_[j];
    // A tenth of the tolerance per step, for about ten steps.
    return {laws_[segment.section],
            segment,
            unloaded.twists.col(segment.section),
            profileOf(segment.section, unloaded),
            constantCompliance(segment.section, unloaded),
            share,
            size_,
            moment_unit_,
            0.1 * tolerance_};
  }

  /// Rotation of the unloaded arm from the start of a section to s of it.
  lie::SO3 unloadedRotation(int section, double s, const model::Unloaded& unloaded) const {
    if (!laws_[section].taper) return lie::SO3::exp(s * unloaded.twists.col(section).tail<3>());
    return {Eigen::Quaterniond(unloadedMotion(section, 0.0, s, unloaded).rotation)};
  }

  /// Motion of the unloaded arm between two s of a section.
  lie::SE3 unloadedMotion(int section, double from, double to,
                          const model::Unloaded& unloaded) const {
    const auto profile = profileOf(section, unloaded);
    if (!profile) return lie::SE3::exp((to - from) * unloaded.twists.col(section));
    const int cells = laws_[section].taper->cells();
    lie::SE3 X;
    // Many steps of each cell: this is the start of a search and the shape of a weightless arm.
    for (int step = 0; step < kSteps * cells; ++step) {
      const double begin = std::max(from, static_cast<double>(step) / (kSteps * cells));
      const double end = std::min(to, (step + 1.0) / (kSteps * cells));
      if (begin < end) X = X * lie::SE3::exp(profile->step(begin, end));
    }
    return X;
  }

  /// Twist per body wrench at s of a section.
  lie::Matrix6 compliance(int section, double s, const model::Unloaded& unloaded) const {
    const SectionLaw& law = laws_[section];
    return law.taper ? lie::Matrix6(law.per_K * law.taper->complianceAt(s))
                     : constantCompliance(section, unloaded);
  }

  bool tapered() const { return tapered_; }
  bool hasTables() const { return has_tables_; }

  /// Magnitude of the whole load [N], [N m].
  double forceScale() const { return force_scale_; }
  double momentScale() const { return moment_scale_; }
  /// Moment that bends the arm by about one radian [N m].
  double momentUnit() const { return moment_unit_; }
  /// False if a moment keeps its direction: no potential energy then decides about stability.
  bool conservative() const { return conservative_; }

 private:
  // Into segments. @param points  from the base to the tip.
  void divide(const model::Arm& arm, const Load& load, std::vector<PointLoad> points) {
    // From the tip to the base, since a force acts on everything before it.
    Eigen::Vector3d force = Eigen::Vector3d::Zero();
    std::vector<Segment> backward;
    for (int k = arm.sectionCount() - 1; k >= 0; --k) {
      const Eigen::Vector3d weight = load.mass[k] * load.gravity;
      const double c = laws_[k].C.bottomRightCorner<3, 3>().norm(), l = arm.freeLength(k);
      double end = 1.0;
      while (end > 0) {
        std::vector<Pull> pulls;
        while (!points.empty() && points.back().section + points.back().s >= k + end) {
          const PointLoad& point = points.back();
          pulls.push_back({point.offset, load.forceOf(point), point.moment});
          force += pulls.back().force;
          points.pop_back();
        }
        const double begin =
            std::max(!points.empty() && points.back().section == k ? points.back().s : 0.0,
                     lastKnot(laws_[k], end));
        const double largest = std::max(force.norm(), (force + (end - begin) * weight).norm());
        const double growth = std::sqrt(c * l * largest) * (end - begin);
        const int parts =
            static_cast<int>(std::clamp(std::ceil(growth / kGrowth), 1.0, 1.0 * kMaxSegments));
        for (int i = parts; i > 0; --i) {
          const auto at = [&](int part) {
            return part == parts ? end : begin + (end - begin) * part / parts;
          };
          backward.push_back({k, at(i - 1), at(i), force, weight, std::move(pulls),
                              std::min(growth / parts, kMostGrowth)});
          pulls.clear();
          force += (at(i) - at(i - 1)) * weight;
        }
        end = begin;
      }
    }
    segments_.assign(std::make_move_iterator(backward.rbegin()),
                     std::make_move_iterator(backward.rend()));
  }

  double tolerance_;
  std::vector<SectionLaw> laws_;
  std::vector<Segment> segments_;
  std::shared_ptr<const model::Links> links_;
  std::vector<int> first_;  // actuator of each section
  bool tapered_ = false;
  bool has_tables_ = false;

  lie::Matrix6 constantCompliance(int section, const model::Unloaded& unloaded) const {
    return has_tables_ ? lie::Matrix6(unloaded.compliance.middleCols<6>(6 * section))
                       : laws_[section].C;
  }

  std::optional<model::TaperTwist<lie::SE3>> profileOf(int section,
                                                       const model::Unloaded& unloaded) const {
    const SectionLaw& law = laws_[section];
    if (!law.taper) return std::nullopt;
    return model::TaperTwist<lie::SE3>(
        *law.taper,
        unloaded.lengths.segment(first_[section], first_[section + 1] - first_[section]));
  }

  double size_ = 0.0;  // length of the arm [m]
  double force_scale_ = 0.0;
  double moment_scale_ = 0.0;
  bool conservative_ = true;
  double moment_unit_ = 1.0;
};

}  // namespace helix_arm::statics
