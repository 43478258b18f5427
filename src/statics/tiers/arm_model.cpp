#include "helix_arm/statics/arm_model.hpp"

#include <utility>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/statics/exact.hpp"
#include "helix_arm/statics/loaded.hpp"
#include "helix_arm/statics/stiffness_by_input.hpp"
#include "helix_arm/statics/unloaded_change.hpp"
#include "statics/loaded/shape_motion.hpp"

namespace helix_arm::statics {
namespace {

// Up to as many, differences of tips that start at the solution take less time than the linear
// equations of their derivative (loaded_benchmark); of the lowest order, for any number.
constexpr int kFewActuators = 5;

// The maps of all sections (dof * sections x n): derivatives of the twists by each free length.
template <class Group>
Eigen::MatrixXd mapOf(const model::ArmOf<Group>& arm) {
  Eigen::MatrixXd map =
      Eigen::MatrixXd::Zero(Group::kDof * arm.sectionCount(), arm.actuatorCount());
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const auto& block = arm.equilibrium(k).map;
    map.block(Group::kDof * k, arm.firstActuator(k), Group::kDof, block.cols()) = block;
  }
  return map;
}

template <class Group>
ActuatorChange<Group> byLengths(const model::ArmOf<Group>& arm, const Load* load,
                                const Eigen::VectorXd& lengths) {
  return {arm, load, lengths, ActuatorChange<Group>::By::kLengths};
}

template <class Group>
TipResponse responseInSpace(const TipResponseOf<Group>& response) {
  return {inSpace<Group>(response), motionsInSpace(response.by)};
}

}  // namespace

struct ArmModel::Solvers {
  Solvers(model::Arm given, std::optional<model::PlanarArm> given_planar,
          std::optional<Load> given_load, TierChoice given_choice)
      : arm(std::move(given)),
        planar(std::move(given_planar)),
        load(std::move(given_load)),
        choice(std::move(given_choice)) {
    const TierSetting& setting = choice.setting;
    if (setting.tier == Tier::kPlanar) plane = &*planar;
    if (!takesLoad(setting.tier)) return;
    taken = &*load;
    if (setting.tier == Tier::kExact) {
      exact.emplace(arm, *load);
      return;
    }
    differs = arm.isLinear() && load->tables.empty() &&
              (setting.order == kLeastOrder || arm.actuatorCount() <= kFewActuators);
    if (planar && staysInPlane(arm, *load)) {
      plane = &*planar;
      planar_loaded.emplace(*planar, *load, setting.order);
    } else {
      loaded.emplace(arm, *load, setting.order);
    }
  }
  Solvers(const Solvers&) = delete;  // its parts refer to each other
  Solvers& operator=(const Solvers&) = delete;

  // Calls for either arm, at inputs (n), which throws as Arm::lengths() does, or at free lengths
  // (n).
  auto atInputs(const model::InputRef& q) const {
    return [&](const auto& of) {
      return taken != nullptr ? unloadedUnder(of, *taken, q) : of.unloaded(q);
    };
  }
  auto atLengths(const Eigen::VectorXd& lengths) const {
    return [&](const auto& of) {
      return taken != nullptr ? unloadedUnderOfLengths(of, *taken, lengths)
                              : of.unloadedOfLengths(lengths);
    };
  }

  // @param unloaded  the state without load of either arm, as those above.
  template <class Unloaded>
  Solution solve(const Unloaded& unloaded) const {
    if (planar_loaded) return planar_loaded->solve(unloaded(*plane));
    if (loaded) return loaded->solve(unloaded(arm));
    if (exact) return exact->solve(unloaded(arm));
    Solution solution;
    solution.shape =
        plane != nullptr ? embeddedShape(unloaded(*plane)) : model::shapeOf(arm, unloaded(arm));
    solution.tip = model::tipPose(solution.shape);
    return solution;
  }

  // @param direct  the tip of either arm without load.
  template <class Unloaded, class Direct>
  Tip tip(const Unloaded& unloaded, const Direct& direct) const {
    if (loaded) return loaded->tip(unloaded(arm));
    if (planar_loaded) return inSpace(planar_loaded->tip(unloaded(*plane)));
    if (exact) return exact->solve(unloaded(arm));
    Tip found;
    found.tip = plane != nullptr ? lie::embed(direct(*plane)) : direct(arm);
    return found;
  }

  model::Shape embeddedShape(const model::UnloadedOf<lie::SE2>& unloaded) const {
    if (!plane->tapered()) return model::shapeOf(arm, model::embed(unloaded.twists));
    return {motionsInSpace(plane->pieces(unloaded)), plane->piecesPerSection(), arm.links()};
  }

  TipResponse responseOf(const ExactArm& tier, const Eigen::VectorXd& lengths) const {
    const ShapeResponse found =
        tier.differentiate(atLengths(lengths)(arm), byLengths(arm, taken, lengths), false);
    TipResponse out{found.at, found.by.tip};
    // Velocities are seen from the base; motions of the body, from the tip.
    for (const int half : {0, 3}) {
      out.by.middleRows<3>(half) = out.tip.rotation.transpose() * found.by.tip.middleRows<3>(half);
    }
    return out;
  }
  template <class Group>
  TipResponse responseOf(const LoadedArmOf<Group>& tier, const model::ArmOf<Group>& of,
                         const Eigen::VectorXd& lengths) const {
    return responseInSpace(differs
                               ? tier.tipByUnloaded(of.twistsOfLengths(lengths), mapOf(of))
                               : tier.tipBy(atLengths(lengths)(of), byLengths(of, taken, lengths)));
  }
  // Without load.
  template <class Group>
  TipResponse responseOf(const model::ArmOf<Group>& of, const Eigen::VectorXd& lengths) const {
    const model::UnloadedOf<Group> unloaded = of.unloadedOfLengths(lengths);
    TipResponseOf<Group> out{{of.tipOfLengths(lengths)}, {}};
    out.by.resize(Group::kDof, of.actuatorCount());
    const auto take = [&out](int i, const auto& motion) { out.by.col(i) = motion; };
    if (of.isLinear()) {
      forTipMotions(of, unloaded.twists, take);
    } else {
      forTipMotionsOfPieces(of, unloaded, take);
    }
    return responseInSpace(out);
  }

  const model::Arm arm;
  const std::optional<model::PlanarArm> planar;
  const std::optional<Load> load;
  const TierChoice choice;
  const model::PlanarArm* plane = nullptr;  // set if the arm is solved in its plane
  const Load* taken = nullptr;              // null if the tier takes no load
  bool differs = false;  // whether differences of constant twists are the fastest response
  std::optional<LoadedArm> loaded;
  std::optional<PlanarLoadedArm> planar_loaded;
  std::optional<ExactArm> exact;
};

ArmModel::ArmModel(model::Arm arm, std::optional<model::PlanarArm> planar, std::optional<Load> load,
                   const TierRequest& request) {
  TierChoice choice = chooseTier(arm, planar, load, request);
  solvers_ = std::make_shared<const Solvers>(std::move(arm), std::move(planar), std::move(load),
                                             std::move(choice));
}
ArmModel::ArmModel(model::Arm arm, std::optional<model::PlanarArm> planar, std::optional<Load> load,
                   const TierSetting& setting) {
  basics::requireKey(setting.tier != Tier::kPlanar || planar, "tier",
                     "planar needs an arm in a plane");
  basics::requireKey(!takesLoad(setting.tier) || load, "tier", nameOf(setting.tier),
                     " needs a load");
  solvers_ = std::make_shared<const Solvers>(std::move(arm), std::move(planar), std::move(load),
                                             TierChoice{setting, 0.0, "as set by the caller"});
}

const model::Arm& ArmModel::arm() const { return solvers_->arm; }
const std::optional<model::PlanarArm>& ArmModel::planar() const { return solvers_->planar; }
const std::optional<Load>& ArmModel::load() const { return solvers_->load; }
const TierChoice& ArmModel::choice() const { return solvers_->choice; }

bool ArmModel::isLinear() const { return !takesLoad(choice().setting.tier) && arm().isLinear(); }

ArmModel ArmModel::scaledStiffness(const model::Stiffness& factors, double K_eps_factor) const {
  std::optional<model::PlanarArm> flat;
  if (planar()) flat = planar()->scaledStiffness(factors);
  std::optional<Load> scaled = load();
  if (scaled) {
    for (double& K_eps : scaled->K_eps) K_eps *= K_eps_factor;
  }
  return {arm().scaledStiffness(factors), std::move(flat), std::move(scaled), choice().setting};
}

ArmModel ArmModel::withTier(const TierRequest& request) const {
  return {arm(), planar(), load(), request};
}

Solution ArmModel::solve(const model::InputRef& q) const {
  return solvers_->solve(solvers_->atInputs(q));
}
Solution ArmModel::solveLengths(const Eigen::VectorXd& lengths) const {
  return solvers_->solve(solvers_->atLengths(lengths));
}
Tip ArmModel::tip(const model::InputRef& q) const {
  return solvers_->tip(solvers_->atInputs(q), [&](const auto& of) { return of.tip(q); });
}
Tip ArmModel::tipOfLengths(const Eigen::VectorXd& lengths) const {
  return solvers_->tip(solvers_->atLengths(lengths),
                       [&](const auto& of) { return of.tipOfLengths(lengths); });
}

std::vector<model::CurvePoint<lie::SE3>> ArmModel::curve(const model::InputRef& q,
                                                         int count) const {
  const auto unloaded = solvers_->atInputs(q);
  if (solvers_->planar_loaded) {
    return solvers_->planar_loaded->curve(unloaded(*solvers_->plane), count);
  }
  if (solvers_->loaded) return solvers_->loaded->curve(unloaded(arm()), count);
  if (solvers_->exact) return solvers_->exact->curve(unloaded(arm()), count);
  return model::sampleCurve(solve(q).shape, count);
}

TipResponse ArmModel::tipResponse(const Eigen::VectorXd& lengths) const {
  const Solvers& by = *solvers_;
  if (by.loaded) return by.responseOf(*by.loaded, by.arm, lengths);
  if (by.planar_loaded) return by.responseOf(*by.planar_loaded, *by.plane, lengths);
  if (by.exact) return by.responseOf(*by.exact, lengths);
  return by.plane != nullptr ? by.responseOf(*by.plane, lengths) : by.responseOf(by.arm, lengths);
}

model::Shape startingShape(const ArmModel& model, const Solution& solution,
                           const model::InputRef& q) {
  return solution.converged() ? solution.shape
                              : model::shapeOf(model.arm(), model.arm().unloaded(q));
}

}  // namespace helix_arm::statics
