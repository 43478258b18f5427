#include "helix_arm/model/arm.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>

#include "basics/fraction.hpp"
#include "helix_arm/basics/requirement.hpp"

namespace helix_arm::model {
namespace {

// Condition of A, scaled to lengths: its entries are sums, which lose half the digits that a stack
// keeps.
constexpr double kWorstCondition = 1e9;

// The index of the end of the interval of q, which is within the inputs.
std::size_t intervalOf(const std::vector<double>& input, double q) {
  const auto above = std::upper_bound(input.begin() + 1, input.end() - 1, q);
  return static_cast<std::size_t>(above - input.begin());
}

void requireStiffness(const Stiffness& stiffness, const std::string& who) {
  for (const auto& [name, value] :
       {std::pair{"K_gamma", stiffness.gamma}, std::pair{"K_tau", stiffness.tau},
        std::pair{"K_kappa", stiffness.kappa}}) {
    basics::require(value >= 0 && value <= 1e300, who, " has ", name, " = ", value,
                    "; expected a finite value >= 0");
  }
}

template <class Group>
bool isConstant(const std::vector<Group>& taper) {
  return std::all_of(taper.begin(), taper.end(), [&taper](const Group& X) {
    return X.rotation == taper.front().rotation && X.translation == taper.front().translation;
  });
}

// Null if nothing is rigid.
template <class Group>
std::shared_ptr<const LinksOf<Group>> linksOf(const std::vector<SectionOf<Group>>& sections,
                                              const Group& tool) {
  LinksOf<Group> links;
  bool any = false;
  for (const SectionOf<Group>& section : sections) {
    basics::require(std::isfinite(section.plate) && section.plate >= 0, "section ",
                    links.size() + 1, ": its plate is ", section.plate,
                    " m long; expected a finite value >= 0");
    any = any || section.plate > 0;
    links.emplace_back();
    links.back().translation.x() = section.plate;
  }
  basics::require(tool.rotation.allFinite() && tool.translation.allFinite(),
                  "the pose of the tool is not finite");
  any = any || !tool.rotation.isIdentity(0) || !tool.translation.isZero(0);
  if (!any) return nullptr;
  links.back() = links.back() * tool;
  return std::make_shared<const LinksOf<Group>>(std::move(links));
}

// Samples for the choice of the Magnus steps.
constexpr int kStepSamples = 64;
constexpr double kTipError = 1e-5;    // of the arm's length
constexpr double kCurveError = 2e-4;  // the same, of points within a piece

// How far a piece of constant twist is from the curve between its ends, about: v changes by `slope`
// over it, and so does the curvature.
template <class Tangent>
double errorWithin(const MagnusTerms<Tangent>& g) {
  constexpr int kSpace = Tangent::RowsAtCompileTime == 6 ? 3 : 2;
  return g.slope.template head<kSpace>().norm() / 8 +
         bracket(g.value, g.slope).template head<kSpace>().norm() / 125;
}

// Equations A g = D l of a section (eq. 17) whose stiffness follows from its inputs. Angles are
// scaled by S to arc lengths, so that bending is not mistaken for noise.
template <class Group>
struct Equations {
  using Tangent = typename Group::Tangent;
  using Matrix = typename Group::Matrix;
  Tangent S = Tangent::Ones(), D_l = Tangent::Zero();
  Eigen::LDLT<Matrix> A;

  Tangent twist() const { return S.cwiseProduct(Tangent(A.solve(D_l))); }
  Matrix compliance() const { return S.asDiagonal() * A.solve(Matrix(S.asDiagonal())); }
};

// @param bending  factor on K_kappa.
// @param factors  on the stiffness of each actuator of the arm; null: 1.
template <class Group>
Equations<Group> equationsOf(const std::vector<ActuatorOf<Group>>& actuators, int begin, int end,
                             const Eigen::Ref<const Eigen::VectorXd>& lengths, double bending,
                             const Eigen::VectorXd* factors) {
  using Tangent = typename Group::Tangent;
  using Matrix = typename Group::Matrix;
  Equations<Group> out;
  double offset = 0.0;
  for (int i = begin; i < end; ++i) {
    offset = std::max(offset, actuators[i].X_O.translation.norm());
  }
  if (offset > 0) out.S.template tail<Group::kRotations>().setConstant(1.0 / offset);
  Matrix A = Matrix::Zero();
  for (int i = begin; i < end; ++i) {
    const Matrix M = actuators[i].X_O.inverse().adjoint() * out.S.asDiagonal();
    Stiffness stiffness = actuators[i].stiffness;
    stiffness.kappa *= bending;
    const Tangent K =
        (factors != nullptr ? (*factors)[i] : 1.0) * stiffness.template diagonal<Group>();
    A += M.transpose() * K.asDiagonal() * M;
    out.D_l += K[0] * lengths[i] * M.row(0).transpose();
  }
  out.A.compute(A);
  return out;
}

}  // namespace

template <>
lie::SE3::Tangent Stiffness::diagonal<lie::SE3>() const {
  lie::SE3::Tangent K;
  K << 1, gamma, gamma, tau, kappa, kappa;
  return K;
}

template <>
lie::SE2::Tangent Stiffness::diagonal<lie::SE2>() const {
  return {1, gamma, kappa};
}

double StiffnessTable::at(double q) const {
  if (empty()) return 1.0;
  if (q < input.front()) return factor.front();
  if (q >= input.back()) return factor.back();
  const std::size_t i = intervalOf(input, q);
  const double t = (q - input[i - 1]) / (input[i] - input[i - 1]);
  return (1.0 - t) * factor[i - 1] + t * factor[i];
}

double StiffnessTable::slopeAt(double q) const {
  if (input.size() < 2 || q < input.front() || q > input.back()) return 0.0;
  const std::size_t i = intervalOf(input, q);
  return (factor[i] - factor[i - 1]) / (input[i] - input[i - 1]);
}

void StiffnessTable::validate(const char* who, const char* factors) const {
  basics::requireValue(input.size() == factor.size(), who, "the number of a table's factors",
                       static_cast<double>(factor.size()), "one per input");
  basics::requireValue(
      std::adjacent_find(input.begin(), input.end(), std::greater_equal<>()) == input.end(), who,
      "an input of a table", empty() ? 0.0 : input.front(), "ascending inputs");
  for (const double one : factor) {
    basics::requireValue(std::isfinite(one) && one >= 1, who, factors, one, "a finite value >= 1");
  }
}

double BendingTable::argumentAt(const Eigen::Ref<const Eigen::VectorXd>& q) const noexcept {
  const double weights = q.cwiseAbs().sum(), sum = q.sum();
  if (argument == Argument::kMean || q.size() < 2 || weights == 0) return q.mean();
  return (q.cwiseAbs().array() * (sum - q.array())).sum() /
         (weights * static_cast<double>(q.size() - 1));
}

double BendingTable::argumentSlope(const Eigen::Ref<const Eigen::VectorXd>& q,
                                   int i) const noexcept {
  const double weights = q.cwiseAbs().sum();
  const auto count = static_cast<double>(q.size());
  if (argument == Argument::kMean || q.size() < 2 || weights == 0) return 1 / count;
  const double others = (q.sum() - q[i]) / (count - 1);
  const double by_weight = std::copysign(1.0, q[i]) * (others - argumentAt(q));
  return (by_weight + (weights - std::abs(q[i])) / (count - 1)) / weights;
}

template <class Group>
typename Group::Tangent Stiffness::bending() const {
  typename Group::Tangent K = Stiffness{0, 0, kappa}.diagonal<Group>();
  K[0] = 0;  // K is normalised by it
  return K;
}
template lie::SE2::Tangent Stiffness::bending<lie::SE2>() const;
template lie::SE3::Tangent Stiffness::bending<lie::SE3>() const;

template <class Group>
ArmOf<Group>::ArmOf(std::vector<SectionOf<Group>> sections, const Group& tool)
    : ArmOf(std::move(sections), tool, 0) {}

template <class Group>
ArmOf<Group>::ArmOf(std::vector<SectionOf<Group>> sections, const Group& tool, int steps)
    : tool_(tool) {
  basics::require(!sections.empty() && sections.size() <= kMaxSections, "the arm has ",
                  sections.size(), " sections; expected 1 to ", kMaxSections);
  links_ = linksOf(sections, tool);
  for (const SectionOf<Group>& section : sections) plates_.push_back(section.plate);
  for (std::size_t k = 0; k < sections.size(); ++k) {
    const std::string where = "section " + std::to_string(k + 1) + ": ";
    std::vector<ActuatorElement<Group>> elements;
    bool tapered = false;
    first_.push_back(static_cast<int>(actuators_.size()));
    for (ActuatorOf<Group>& actuator : sections[k].actuators) {
      requireStiffness(actuator.stiffness, where + actuator.name);
      try {
        actuator.response.validate();
      } catch (const std::invalid_argument& error) {
        throw std::invalid_argument(where + actuator.name + ": " + error.what());
      }
      const Range& range = actuator.contraction.inputRange();
      const Range& limits = actuator.limits;
      basics::require(range.contains(limits.lower) && range.contains(limits.upper) &&
                          limits.lower < limits.upper,
                      where, actuator.name, " has limits [", limits.lower, ", ", limits.upper,
                      "]; expected a range inside its contraction's [", range.lower, ", ",
                      range.upper, "]");
      elements.push_back({actuator.X_O, actuator.stiffness.template diagonal<Group>()});
      if (isConstant(actuator.taper)) actuator.taper.clear();
      tapered = tapered || !actuator.taper.empty();
      if (!actuator.taper.empty()) actuator.X_O = actuator.taper.front();
    }
    try {
      tapers_.push_back(tapered ? std::make_shared<const TaperOf<Group>>(sections[k].actuators)
                                : nullptr);
      equilibria_.push_back(tapered ? tapers_[k]->mean() : solveEquilibrium(elements));
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(where + error.what());
    }
    for (ActuatorOf<Group>& actuator : sections[k].actuators) {
      actuators_.push_back(std::move(actuator));
    }
  }
  first_.push_back(static_cast<int>(actuators_.size()));
  for (int k = 0; k < sectionCount(); ++k) {
    rest_twists_.push_back(equilibria_[k].map * restLengths(k));
    setBending(k, sections[k].bending);
  }
  section_steps_.resize(tapers_.size());
  const bool tapered =
      std::any_of(tapers_.begin(), tapers_.end(), [](const auto& t) { return t != nullptr; });
  is_linear_ = !tapered && !has_tables_;
  if (tapered && steps > 0) setSteps(steps);
  if (tapered && steps == 0) chooseSteps();
}

template <class Group>
const char* ArmOf<Group>::needForTables(int k) const {
  if (tapers_[k]) return "a section without taper";
  if (equilibria_[k].rank < Group::kDof) {
    return "stiffness against every motion; give K_tau_m2 and K_kappa_m2 values > 0";
  }
  return equilibria_[k].condition <= kWorstCondition
             ? nullptr
             : "shear and bending of comparable stiffness; lower K_gamma";
}

template <class Group>
void ArmOf<Group>::setBending(int k, const BendingTable& table) {
  const std::string who = "section " + std::to_string(k + 1);
  table.validate(who.c_str(), "a factor on K_kappa");
  bending_.emplace_back();
  // A constant table is a number.
  const auto& factor = table.factor;
  if (std::all_of(factor.begin(), factor.end(), [](double one) { return one == 1; })) return;
  const char* const need = needForTables(k);
  basics::require(need == nullptr, who, ": K_kappa depends on pressure, which needs ", need);
  bending_[k] = table;
  has_tables_ = true;
  Lengths rest(actuators_.size());
  for (int i = 0; i < rest.size(); ++i) rest[i] = actuators_[i].contraction.restLength();
  rest_twists_[k] = twistAt(rest, nullptr, k);
}

template <class Group>
template <class StiffnessOf>
ArmOf<Group> ArmOf<Group>::stiffened(const StiffnessOf& stiffnessOf) const {
  std::vector<SectionOf<Group>> sections(sectionCount());
  for (int k = 0; k < sectionCount(); ++k) {
    for (int i = first_[k]; i < first_[k + 1]; ++i) {
      sections[k].actuators.push_back(actuators_[i]);
      sections[k].actuators.back().stiffness = stiffnessOf(i);
    }
    sections[k].plate = plates_[k];
    sections[k].bending = bending_[k];
  }
  return ArmOf(std::move(sections), tool_, steps_);
}

template <class Group>
ArmOf<Group> ArmOf<Group>::withStiffness(const Stiffness& stiffness) const {
  return stiffened([&](int) { return stiffness; });
}

template <class Group>
ArmOf<Group> ArmOf<Group>::withStiffness(int actuator, const Stiffness& stiffness) const {
  return stiffened([&](int i) { return i == actuator ? stiffness : actuators_[i].stiffness; });
}

template <class Group>
ArmOf<Group> ArmOf<Group>::scaledStiffness(const Stiffness& factors) const {
  return stiffened([&](int i) {
    const Stiffness& own = actuators_[i].stiffness;
    return Stiffness{own.gamma * factors.gamma, own.tau * factors.tau, own.kappa * factors.kappa};
  });
}

template <class Group>
void ArmOf<Group>::check(const InputRef& q) const {
  if (q.size() != actuatorCount()) refuse(q);
  for (int i = 0; i < actuatorCount(); ++i) {
    if (!actuators_[i].limits.contains(q[i])) refuse(q);
  }
}

template <class Group>
void ArmOf<Group>::refuse(const InputRef& q) const {
  basics::require(q.size() == actuatorCount(), "got ", q.size(), " inputs; the arm has ",
                  actuatorCount(), " actuators");
  int i = 0;
  while (i + 1 < actuatorCount() && actuators_[i].limits.contains(q[i])) ++i;
  const Range& limits = actuators_[i].limits;
  const DriveUnit unit = unitOf(actuators_[i].drive);
  throw std::out_of_range(basics::messageOf(actuators_[i].name, " is asked for ", q[i],
                                            "; its limits are [", limits.lower, ", ", limits.upper,
                                            "] ", unit.si, unit.pressure ? " (gauge)" : ""));
}

template <class Group>
double ArmOf<Group>::restLength() const {
  double length = 0.0;
  for (int k = 0; k < sectionCount(); ++k) length += restLength(k);
  return length;
}

template <class Group>
std::vector<std::string> ArmOf<Group>::actuatorNames() const {
  std::vector<std::string> names;
  names.reserve(actuators_.size());
  for (const ActuatorOf<Group>& actuator : actuators_) names.push_back(actuator.name);
  return names;
}

template <class Group>
double ArmOf<Group>::freeLength(int k) const {
  double sum = 0.0;
  for (int i = first_[k]; i < first_[k + 1]; ++i) sum += actuators_[i].contraction.restLength();
  return sum / (first_[k + 1] - first_[k]);
}

template <class Group>
Eigen::VectorXd ArmOf<Group>::inputAt(const Eigen::VectorXd& fraction) const {
  Eigen::VectorXd q = fraction;
  if (q.size() != actuatorCount()) refuse(q);
  for (int i = 0; i < q.size(); ++i) {
    const Range& limits = actuators_[i].limits;
    // Rounding may exceed the limit.
    q[i] = std::min(limits.lower + fraction[i] * (limits.upper - limits.lower), limits.upper);
  }
  return q;
}

template <class Group>
Eigen::VectorXd ArmOf<Group>::inputAt(double fraction) const {
  return inputAt(Eigen::VectorXd(Eigen::VectorXd::Constant(actuatorCount(), fraction)));
}

template <class Group>
Eigen::VectorXd ArmOf<Group>::clamped(Eigen::VectorXd q) const {
  if (q.size() != actuatorCount()) refuse(q);
  for (int i = 0; i < actuatorCount(); ++i) {
    const Range& limits = actuators_[i].limits;
    q[i] = std::clamp(q[i], limits.lower, limits.upper);
  }
  return q;
}

template <class Group>
Eigen::VectorXd ArmOf<Group>::lengths(const InputRef& q) const {
  check(q);
  return lengthsInside(q);
}

template <class Group>
typename ArmOf<Group>::Lengths ArmOf<Group>::lengthsInside(const InputRef& q) const noexcept {
  Lengths out(q.size());
  for (int i = 0; i < actuatorCount(); ++i) out[i] = actuators_[i].contraction.lengthInside(q[i]);
  return out;
}

template <class Group>
typename TaperOf<Group>::Lengths ArmOf<Group>::ofSection(const InputRef& lengths,
                                                         int k) const noexcept {
  return lengths.segment(first_[k], first_[k + 1] - first_[k]);
}

template <class Group>
typename TaperOf<Group>::Lengths ArmOf<Group>::restLengths(int k) const {
  typename TaperOf<Group>::Lengths out(first_[k + 1] - first_[k]);
  for (int i = 0; i < out.size(); ++i) {
    out[i] = actuators_[first_[k] + i].contraction.restLength();
  }
  return out;
}

template <class Group>
typename ArmOf<Group>::Twists ArmOf<Group>::twists(const InputRef& q) const {
  check(q);
  if (!isLinear()) return twistsAt(lengthsInside(q), &q);
  Twists out(Group::kDof, sectionCount());
  for (int k = 0; k < sectionCount(); ++k) out.col(k) = sectionTwist(q, k);
  return out;
}

template <class Group>
typename Group::Tangent ArmOf<Group>::sectionTwist(const InputRef& q, int k) const noexcept {
  // From the twist at rest, large bending entries multiply length changes only: more digits stay.
  typename Group::Tangent g = rest_twists_[k];
  const auto& map = equilibria_[k].map;
  const int first = first_[k], count = first_[k + 1] - first;
  for (int i = 0; i < count; ++i) {
    g += map.col(i) * actuators_[first + i].contraction.changeInside(q[first + i]);
  }
  return g;
}

template <class Group>
typename ArmOf<Group>::Twists ArmOf<Group>::twistsOfLengths(
    const InputRef& lengths) const noexcept {
  return twistsAt(lengths, nullptr);
}

template <class Group>
typename ArmOf<Group>::Twists ArmOf<Group>::twistsAt(const InputRef& lengths,
                                                     const InputRef* q) const noexcept {
  Twists out(Group::kDof, sectionCount());
  for (int k = 0; k < sectionCount(); ++k) {
    if (!isLinear()) {
      out.col(k) = twistAt(lengths, q, k);
      continue;
    }
    out.col(k).noalias() =
        equilibria_[k].map.lazyProduct(lengths.segment(first_[k], first_[k + 1] - first_[k]));
  }
  return out;
}

template <class Group>
typename Group::Tangent ArmOf<Group>::twistAt(const InputRef& lengths, const InputRef* q,
                                              int k) const noexcept {
  if (tapers_[k]) return taperedTwist(ofSection(lengths, k), k);
  if (bending_[k].empty()) return equilibria_[k].map * ofSection(lengths, k);
  const BendingTable& table = bending_[k];
  const double factor = q != nullptr ? table.at(table.argumentAt(ofSection(*q, k)))
                                     : bendingOfLengths(lengths, k).factor;
  return equationsOf(actuators_, first_[k], first_[k + 1], lengths, factor, nullptr).twist();
}

template <class Group>
typename ArmOf<Group>::Bending ArmOf<Group>::bendingOfLengths(const InputRef& lengths,
                                                              int k) const noexcept {
  const int count = first_[k + 1] - first_[k];
  Bending out{0.0, TaperOf<Group>::Lengths::Zero(count)};
  typename TaperOf<Group>::Lengths inputs(count);
  for (int j = 0; j < count; ++j) {
    const ActuatorOf<Group>& actuator = actuators_[first_[k] + j];
    const auto [q, inside] = nearestInput(actuator, lengths[first_[k] + j]);
    if (inside) out.by_length[j] = 1 / actuator.contraction.slopeInside(q);
    inputs[j] = q;
  }
  const BendingTable& table = bending_[k];
  const double argument = table.argumentAt(inputs), slope = table.slopeAt(argument);
  for (int j = 0; j < count; ++j) out.by_length[j] *= slope * table.argumentSlope(inputs, j);
  out.factor = table.at(argument);
  return out;
}

template <class Group>
typename ArmOf<Group>::Balance ArmOf<Group>::balance(
    int k, const InputRef& lengths, double bending, const Eigen::VectorXd* factors) const noexcept {
  const auto equations =
      equationsOf(actuators_, first_[k], first_[k + 1], lengths, bending, factors);
  return {equations.twist(), equations.compliance()};
}

template <class Group>
Group ArmOf<Group>::tip(const InputRef& q) const {
  check(q);
  return tipInside(q);
}

template <class Group>
Group ArmOf<Group>::tipInside(const InputRef& q) const noexcept {
  return isLinear() ? untaperedTip(q) : tipAt(lengthsInside(q), &q);
}

template <class Group>
Group ArmOf<Group>::untaperedTip(const InputRef& q) const noexcept {
  Group X = Group::exp(sectionTwist(q, 0));
  if (links_) X = X * (*links_)[0];
  for (int k = 1; k < sectionCount(); ++k) {
    X = X * Group::exp(sectionTwist(q, k));
    if (links_) X = X * (*links_)[k];
  }
  return X;
}

template <class Group>
Group ArmOf<Group>::tipOfLengths(const InputRef& lengths) const noexcept {
  return isLinear() ? tipOf(twistsOfLengths(lengths)) : tipAt(lengths, nullptr);
}

template <class Group>
Group ArmOf<Group>::tipAt(const InputRef& lengths, const InputRef* q) const noexcept {
  Group X;
  for (int k = 0; k < sectionCount(); ++k) {
    if (tapers_[k]) {
      const auto own = ofSection(lengths, k);
      for (const auto& step : section_steps_[k]) X = X * Group::exp(step.twist(own));
    } else {
      X = X * Group::exp(twistAt(lengths, q, k));
    }
    if (links_) X = X * (*links_)[k];
  }
  return X;
}

template <class Group>
Group ArmOf<Group>::tipOf(const Twists& twists) const {
  Group X;
  for (int k = 0; k < sectionCount(); ++k) {
    X = X * Group::exp(twists.col(k));
    if (links_) X = X * (*links_)[k];
  }
  return X;
}

Arm embed(const PlanarArm& arm) {
  std::vector<Section> sections(arm.sectionCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    for (int i = arm.firstActuator(k); i < arm.firstActuator(k + 1); ++i) {
      const PlanarActuator& a = arm.actuator(i);
      sections[k].actuators.push_back(
          {a.name, lie::embed(a.X_O), a.stiffness, a.contraction, a.limits, a.drive, a.response});
      for (const lie::SE2& X_O : a.taper) {
        sections[k].actuators.back().taper.push_back(lie::embed(X_O));
      }
    }
    sections[k].plate = arm.plate(k);
    sections[k].bending = arm.bending(k);
  }
  return Arm(std::move(sections), lie::embed(arm.tool()));
}

Twists embed(const PlanarTwists& twists) {
  Twists out(6, twists.cols());
  for (int k = 0; k < twists.cols(); ++k) out.col(k) = lie::embed(lie::SE2::Tangent(twists.col(k)));
  return out;
}

// Tapered sections of ArmOf.

template <class Group>
void ArmOf<Group>::setSteps(int steps) {
  steps_ = steps;
  for (int k = 0; k < sectionCount(); ++k) {
    section_steps_[k].clear();
    for (int j = 0; tapers_[k] && j < steps; ++j) {
      section_steps_[k].push_back(
          tapers_[k]->step(static_cast<double>(j) / steps, (j + 1.0) / steps));
    }
    if (tapers_[k]) rest_twists_[k] = taperedTwist(restLengths(k), k);
  }
}

// Doubles the steps until that no longer moves the tip, and pieces follow the curve.
template <class Group>
void ArmOf<Group>::chooseSteps() {
  std::mt19937_64 generator(20240229);
  std::vector<Eigen::VectorXd> samples;  // lengths
  for (int sample = 0; sample < kStepSamples; ++sample) {
    Eigen::VectorXd fraction(actuatorCount());
    for (double& one : fraction) one = basics::fractionOf(generator());
    // Every other one is a corner of the limits, where twists are largest.
    if (sample % 2 == 0) fraction = fraction.array().round().matrix();
    samples.push_back(lengths(inputAt(fraction)));
  }
  const auto tipsWith = [&](int steps) {
    setSteps(steps);
    std::vector<Eigen::Matrix<double, Group::kSpace, 1>> tips;
    for (const auto& sample : samples) tips.push_back(tipOfLengths(sample).translation);
    return tips;
  };
  const int most = kMaxPieces / sectionCount();
  for (int steps = 1;; steps = std::min(2 * steps, most)) {
    const auto finer = tipsWith(2 * steps), tips = tipsWith(steps);
    double moved = 0.0, within = 0.0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      moved = std::max(moved, (finer[i] - tips[i]).norm());
      for (int k = 0; k < sectionCount(); ++k) {
        for (const auto& step : section_steps_[k]) {
          within = std::max(within, errorWithin(step.of(ofSection(samples[i], k))));
        }
      }
    }
    if (moved < kTipError * restLength() && within < kCurveError * restLength()) return;
    basics::require(steps < most, "its taper needs more than ", most, " Magnus steps per section, ",
                    kMaxPieces, " in all; expected a gentler taper, or fewer sections");
  }
}

template <class Group>
typename Group::Tangent ArmOf<Group>::taperedTwist(const typename TaperOf<Group>::Lengths& lengths,
                                                   int k) const noexcept {
  typename Group::Tangent sum = Group::Tangent::Zero();
  for (const auto& step : section_steps_[k]) sum += step.twist(lengths);
  return sum;
}

template <class Group>
UnloadedOf<Group> ArmOf<Group>::unloaded(const InputRef& q) const {
  if (isLinear()) return twists(q);
  return {twists(q), lengths(q)};
}

template <class Group>
UnloadedOf<Group> ArmOf<Group>::unloadedOfLengths(const InputRef& lengths) const {
  if (isLinear()) return twistsOfLengths(lengths);
  return {twistsOfLengths(lengths), lengths};
}

template <class Group>
PiecesOf<Group> ArmOf<Group>::pieces(const UnloadedOf<Group>& unloaded) const {
  if (!tapered()) return unloaded.twists;
  PiecesOf<Group> out(Group::kDof, sectionCount() * steps_);
  for (int k = 0; k < sectionCount(); ++k) {
    auto own = out.middleCols(k * steps_, steps_);
    if (!tapers_[k]) {
      own.colwise() = unloaded.twists.col(k) / steps_;
      continue;
    }
    const auto lengths = ofSection(unloaded.lengths, k);
    for (int j = 0; j < steps_; ++j) own.col(j) = section_steps_[k][j].twist(lengths);
  }
  return out;
}

template <class Group>
typename Equilibrium<Group>::Map ArmOf<Group>::pieceByLengths(
    int k, int j, const UnloadedOf<Group>& unloaded) const {
  if (tapers_[k]) return section_steps_[k][j].byLengths(ofSection(unloaded.lengths, k));
  typename Equilibrium<Group>::Map by = equilibria_[k].map;
  if (!bending_[k].empty()) {
    const Bending bending = bendingOfLengths(unloaded.lengths, k);
    const Balance at = balance(k, unloaded.lengths, bending.factor);
    // A dg = D dl - dA g
    typename Group::Tangent by_factor = Group::Tangent::Zero();
    for (int i = 0; i < by.cols(); ++i) {
      const ActuatorOf<Group>& actuator = actuators_[first_[k] + i];
      const typename Group::Matrix M = actuator.X_O.inverse().adjoint();
      by.col(i) = at.compliance * M.row(0).transpose();
      by_factor -= M.transpose() * actuator.stiffness.template bending<Group>().cwiseProduct(
                                       typename Group::Tangent(M * at.twist));
    }
    by += (at.compliance * by_factor) * bending.by_length.transpose();
  }
  return by / piecesPerSection();
}

template class ArmOf<lie::SE2>;
template class ArmOf<lie::SE3>;

}  // namespace helix_arm::model
