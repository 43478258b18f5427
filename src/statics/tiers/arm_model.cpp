#include "helix_arm/statics/arm_model.hpp"

#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "tier_solver.hpp"

namespace helix_arm::statics {

class ArmModel::Solvers {
 public:
  Solvers(model::Arm given, std::optional<model::PlanarArm> given_planar,
          std::optional<Load> given_load, TierChoice given_choice)
      : arm(std::move(given)),
        planar(std::move(given_planar)),
        load(std::move(given_load)),
        choice(std::move(given_choice)),
        solver(arm, planar, load, choice.setting) {}
  Solvers(const Solvers& other) : Solvers(other.arm, other.planar, other.load, other.choice) {}

  const model::Arm arm;
  const std::optional<model::PlanarArm> planar;
  const std::optional<Load> load;
  const TierChoice choice;
  const TierSolver solver;
};

ArmModel::ArmModel(model::Arm arm, std::optional<model::PlanarArm> planar, std::optional<Load> load,
                   const TierRequest& request) {
  TierChoice choice = chooseTier(arm, planar, load, request);
  solvers_ = std::make_unique<Solvers>(std::move(arm), std::move(planar), std::move(load),
                                       std::move(choice));
}
ArmModel::ArmModel(model::Arm arm, std::optional<model::PlanarArm> planar, std::optional<Load> load,
                   const TierSetting& setting) {
  basics::requireKey(setting.tier != Tier::kPlanar || planar, "tier",
                     "planar needs an arm in a plane");
  basics::requireKey(!takesLoad(setting.tier) || load, "tier", nameOf(setting.tier),
                     " needs a load");
  solvers_ = std::make_unique<Solvers>(std::move(arm), std::move(planar), std::move(load),
                                       TierChoice{setting, 0.0, "as set by the caller"});
}
ArmModel::ArmModel(std::unique_ptr<Solvers> solvers) : solvers_(std::move(solvers)) {}
ArmModel::ArmModel(const ArmModel& other) : solvers_(std::make_unique<Solvers>(*other.solvers_)) {}
ArmModel::ArmModel(ArmModel&&) noexcept = default;
ArmModel& ArmModel::operator=(ArmModel other) noexcept {
  std::swap(solvers_, other.solvers_);
  return *this;
}
ArmModel::~ArmModel() = default;

const model::Arm& ArmModel::arm() const { return solvers_->arm; }
const std::optional<model::PlanarArm>& ArmModel::planar() const { return solvers_->planar; }
const std::optional<Load>& ArmModel::load() const { return solvers_->load; }
const TierChoice& ArmModel::choice() const { return solvers_->choice; }

bool ArmModel::isLinear() const { return !takesLoad(choice().setting.tier) && !arm().tapered(); }

ArmModel ArmModel::withStiffness(const model::Stiffness& stiffness) const {
  std::optional<model::PlanarArm> planar;
  if (solvers_->planar) planar = solvers_->planar->withStiffness(stiffness);
  return ArmModel(std::make_unique<Solvers>(solvers_->arm.withStiffness(stiffness),
                                            std::move(planar), solvers_->load, solvers_->choice));
}

ArmModel ArmModel::withTier(const TierRequest& request) const {
  return {solvers_->arm, solvers_->planar, solvers_->load, request};
}

Solution ArmModel::solve(const model::InputRef& q) const { return solvers_->solver.solveInputs(q); }
Solution ArmModel::solveLengths(const Eigen::VectorXd& lengths) const {
  return solvers_->solver.solve(lengths);
}
Tip ArmModel::tip(const model::InputRef& q) const { return solvers_->solver.tipOfInputs(q); }
Tip ArmModel::tipOfLengths(const Eigen::VectorXd& lengths) const {
  return solvers_->solver.tip(lengths);
}

std::vector<model::CurvePoint<lie::SE3>> ArmModel::curve(const model::InputRef& q,
                                                         int count) const {
  return solvers_->solver.curve(q, count);
}

TipResponse ArmModel::tipResponse(const Eigen::VectorXd& lengths) const {
  return solvers_->solver.tipResponse(lengths);
}

model::Shape startingShape(const ArmModel& model, const Solution& solution,
                           const model::InputRef& q) {
  return solution.converged() ? solution.shape
                              : model::shapeOf(model.arm(), model.arm().unloaded(q));
}

}  // namespace helix_arm::statics
