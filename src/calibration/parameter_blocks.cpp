#include "parameter_blocks.hpp"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <stdexcept>

namespace helix_arm::estimation {
namespace {

// Names of the numbers of a block, without their suffixes.
// @param arm  which has a number for each actuator; null: there is one.
std::vector<std::string> namesOf(const FitParameterInfo& info, const model::Arm* arm) {
  if (arm == nullptr) return {info.name};
  std::vector<std::string> names;
  for (int i = 0; i < arm->actuatorCount(); ++i) {
    names.push_back(info.name + ("_" + arm->actuator(i).name));
  }
  return names;
}

}  // namespace

bool isFree(const CalibrationOptions& options, ParameterBlock block) {
  if (block == ParameterBlock::kShape) return options.free_shapes;
  return std::any_of(options.fit.begin(), options.fit.end(), [&](FitParameter one) {
    const FitParameterInfo& info = infoOf(one);
    const bool is_its = info.block == block ||
                        (block == ParameterBlock::kCurve && one == FitParameter::kContraction);
    return is_its && (info.aboutRig() || !options.free_shapes);
  });
}

std::vector<FitParameter> freeStiffness(const CalibrationOptions& options) {
  std::vector<FitParameter> out;
  std::copy_if(options.fit.begin(), options.fit.end(), std::back_inserter(out),
               [&](auto one) { return infoOf(one).isStiffness() && !options.free_shapes; });
  return out;
}

int lengthScales(const CalibrationOptions& options, const model::Arm& arm) {
  if (!isFree(options, ParameterBlock::kLengthScale)) return 0;
  return options.fits(FitParameter::kLengthScaleEach) ? arm.actuatorCount() : 1;
}

ParameterBlocks::ParameterBlocks(const std::vector<ArmCaptures>& arms,
                                 const CalibrationOptions& options, const ShapeModel& model) {
  const ArmCaptures& first = arms.front();
  const std::vector<TagPlacement>& tags = first.layout.tags;
  if (isFree(options, ParameterBlock::kStiffness)) addStiffness(options, model);
  if (isFree(options, ParameterBlock::kLengthScale)) {
    const FitParameterInfo& info = infoOf(FitParameter::kLengthScale);
    const bool each = lengthScales(options, first.arm) > 1;
    addNumbers(info, options, 0, namesOf(info, each ? &first.arm : nullptr));
  }
  for (const FitParameterInfo& info : fitParameters()) {
    if (!info.hasOwnBlock() || info.block == ParameterBlock::kTag) continue;
    if (!isFree(options, *info.block)) continue;
    addNumbers(info, options, 0, namesOf(info, info.eachActuator() ? &first.arm : nullptr));
  }
  // Tags come last, with one block each, except the one that fixes the frame of all the others.
  const FitParameterInfo& tag = infoOf(FitParameter::kTags);
  const int base_tag = first.layout.baseTag();
  for (int i = 0; isFree(options, *tag.block) && i < static_cast<int>(tags.size()); ++i) {
    if (i == base_tag) continue;
    addNumbers(tag, options, i,
               {tag.name + ("_" + std::to_string(tags[static_cast<std::size_t>(i)].id))});
  }
  // Last, so that the reported parameters come first.
  if (isFree(options, ParameterBlock::kCurve)) addCurve(first.free_curve.value());
}

void ParameterBlocks::addCurve(const FreeCurve& curve) {
  const Eigen::Index count = curve.spline.lengths.size();
  std::vector<ParameterInfo> infos;
  for (Eigen::Index k = 1; k <= count; ++k) {
    infos.push_back({"contraction_" + std::to_string(k), "", 1.0, false, 0.0, 0.0, false, false});
  }
  add(ParameterBlock::kCurve, 0, infos);
}

void ParameterBlocks::loosenCurve(double factor) {
  for (Block& block : blocks_) {
    if (block.kind == ParameterBlock::kCurve) block.deviation *= factor;
  }
}

void ParameterBlocks::add(ParameterBlock kind, int of, const std::vector<ParameterInfo>& infos) {
  Eigen::VectorXd deviation(static_cast<Eigen::Index>(infos.size()));
  std::transform(infos.begin(), infos.end(), deviation.begin(),
                 [](const ParameterInfo& info) { return info.deviation; });
  infos_.insert(infos_.end(), infos.begin(), infos.end());
  add(kind, of, Eigen::VectorXd::Zero(deviation.size()), deviation);
}

void ParameterBlocks::add(ParameterBlock kind, int of, const Eigen::VectorXd& mean,
                          const Eigen::VectorXd& deviation) {
  blocks_.push_back({kind, of, columns(), mean, deviation});
  numbers_.conservativeResize(numbers_.size() + mean.size());
  numbers_.tail(mean.size()) = mean;
}

void ParameterBlocks::addStiffness(const CalibrationOptions& options, const ShapeModel& model) {
  Elasticity initial = model.initial();
  std::vector<ParameterInfo> infos;
  for (const FitParameter entry : freeStiffness(options)) {
    const FitParameterInfo& info = infoOf(entry);
    const FitNumber& number = info.numbers.front();
    infos.push_back({info.name, number.unit, number.prior(options), true, model.referenceOf(entry),
                     entryOf(initial, entry), true});
  }
  add(ParameterBlock::kStiffness, 0, infos);
}

void ParameterBlocks::addNumbers(const FitParameterInfo& info, const CalibrationOptions& options,
                                 int of, const std::vector<std::string>& names) {
  const bool is_log = info.aboutShape();
  const double initial = is_log ? 1.0 : 0.0;
  std::vector<ParameterInfo> infos;
  for (const std::string& name : names) {
    for (const FitNumber& number : info.numbers) {
      infos.push_back({name + number.suffix, number.unit, number.prior(options), is_log, initial,
                       initial, is_log});
    }
  }
  add(*info.block, of, infos);
}

std::vector<ParameterBlocks::Block>::const_iterator ParameterBlocks::find(ParameterBlock kind,
                                                                          int of) const {
  return std::find_if(blocks_.begin(), blocks_.end(),
                      [&](const Block& block) { return block.kind == kind && block.of == of; });
}

int ParameterBlocks::indexOf(ParameterBlock kind, int of) const {
  const auto found = find(kind, of);
  if (found == blocks_.end()) throw std::out_of_range("ParameterBlocks: no such block");
  return static_cast<int>(found - blocks_.begin());
}

Eigen::Map<const Eigen::VectorXd> ParameterBlocks::of(ParameterBlock kind, int of) const {
  const auto found = find(kind, of);
  if (found == blocks_.end()) return {nullptr, 0};
  return {numbers_.data() + found->column, found->size()};
}

lie::Vector6 ParameterBlocks::motionOf(ParameterBlock kind, int index) const {
  const auto numbers = of(kind, index);
  return numbers.size() == 0 ? lie::Vector6::Zero() : lie::Vector6(numbers);
}

double ParameterBlocks::borderShift() const {
  const auto numbers = of(ParameterBlock::kBorderShift);
  return numbers.size() == 0 ? 0.0 : numbers[0];
}

}  // namespace helix_arm::estimation
