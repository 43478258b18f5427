#include "parameter_blocks.hpp"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <stdexcept>
#include <utility>

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

// @param values  constant or not, as are the numbers.
template <class AnyValues>
auto* dataOf(const ParameterBlocks::Block& block, AnyValues& values) {
  if (block.kind == ParameterBlock::kStiffness) return values.stiffness.data();
  if (block.kind == ParameterBlock::kLengthScale) return values.length_scale.data();
  if (block.kind == ParameterBlock::kCurve) return values.curve.data();
  if (block.kind == ParameterBlock::kShape) return values.shapes[block.of].data();
  if (block.kind == ParameterBlock::kTag) return values.tags[block.of].data();
  return values.own_blocks.at(block.kind).data();
}

}  // namespace

bool Selection::has(ParameterBlock block) const {
  if (block == ParameterBlock::kShape) return free_shapes;
  if (block == ParameterBlock::kCurve) return fit.count(FitParameter::kContraction) > 0;
  return std::any_of(fit.begin(), fit.end(),
                     [block](FitParameter one) { return infoOf(one).block == block; });
}

bool Selection::hasOtherThanStiffness() const { return fit.size() > stiffness().size(); }

std::vector<FitParameter> Selection::stiffness() const {
  std::vector<FitParameter> out;
  std::copy_if(fit.begin(), fit.end(), std::back_inserter(out),
               [](FitParameter one) { return infoOf(one).isStiffness(); });
  return out;
}

Selection selectionOf(const CalibrationOptions& options) {
  Selection selection{{}, options.free_shapes};
  for (const FitParameter one : options.fit) {
    const bool of_rig = infoOf(one).aboutRig();
    if (of_rig || !options.free_shapes) selection.fit.insert(one);
  }
  return selection;
}

int lengthScales(const Selection& selection, const model::Arm& arm) {
  if (selection.fit.count(FitParameter::kLengthScaleEach) > 0) return arm.actuatorCount();
  return selection.has(ParameterBlock::kLengthScale) ? 1 : 0;
}

ParameterBlocks::ParameterBlocks(const std::vector<ArmCaptures>& arms,
                                 const CalibrationOptions& options, const Selection& selection,
                                 const ShapeModel& model) {
  const ArmCaptures& first = arms.front();
  const std::vector<TagPlacement>& tags = first.layout.tags;
  values_.stiffness.setZero(static_cast<Eigen::Index>(selection.stiffness().size()));
  values_.length_scale.setZero(lengthScales(selection, first.arm));
  values_.tags.assign(tags.size(), lie::Vector6::Zero());
  if (selection.has(ParameterBlock::kStiffness)) addStiffness(options, selection, model);
  if (selection.has(ParameterBlock::kLengthScale)) {
    const FitParameterInfo& info = infoOf(FitParameter::kLengthScale);
    const bool each = values_.length_scale.size() > 1;
    addNumbers(info, options, 0, namesOf(info, each ? &first.arm : nullptr));
  }
  for (const FitParameterInfo& info : fitParameters()) {
    if (!info.hasOwnBlock() || info.block == ParameterBlock::kTag) continue;
    const std::vector<std::string> names =
        namesOf(info, info.eachActuator() ? &first.arm : nullptr);
    values_.own_blocks[*info.block].setZero(
        static_cast<Eigen::Index>(names.size() * info.numbers.size()));
    if (selection.has(*info.block)) addNumbers(info, options, 0, names);
  }
  // Tags come last, with one block each, except the one that fixes the frame of all the others.
  const FitParameterInfo& tag = infoOf(FitParameter::kTags);
  const int base_tag = first.layout.baseTag();
  for (int i = 0; selection.has(*tag.block) && i < static_cast<int>(tags.size()); ++i) {
    if (i == base_tag) continue;
    addNumbers(tag, options, i,
               {tag.name + ("_" + std::to_string(tags[static_cast<std::size_t>(i)].id))});
  }
  // Last, so that the reported parameters come first.
  if (selection.has(ParameterBlock::kCurve)) addCurve(first.free_curve.value());
}

void ParameterBlocks::addCurve(const FreeCurve& curve) {
  const Eigen::Index count = curve.spline.lengths.size();
  values_.curve.setZero(count);
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
  blocks_.push_back({kind, of, columns(), Eigen::VectorXd::Zero(deviation.size()), deviation});
}

void ParameterBlocks::addStiffness(const CalibrationOptions& options, const Selection& selection,
                                   const ShapeModel& model) {
  Elasticity initial = model.initial();
  std::vector<ParameterInfo> infos;
  for (const FitParameter entry : selection.stiffness()) {
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

void ParameterBlocks::addShape(const Eigen::VectorXd& mean, const Eigen::VectorXd& deviation) {
  blocks_.push_back({ParameterBlock::kShape, static_cast<int>(values_.shapes.size()), columns(),
                     mean, deviation});
  values_.shapes.push_back(mean);
}

int ParameterBlocks::indexOf(ParameterBlock kind, int of) const {
  const auto found = std::find_if(blocks_.begin(), blocks_.end(), [&](const Block& block) {
    return block.kind == kind && block.of == of;
  });
  if (found == blocks_.end()) throw std::out_of_range("ParameterBlocks: no such block");
  return static_cast<int>(found - blocks_.begin());
}

int ParameterBlocks::columns() const {
  return blocks_.empty() ? 0 : blocks_.back().column + blocks_.back().size();
}

// Numbers of shapes come last.
Eigen::VectorXd ParameterBlocks::vector() const {
  return numbers().head(static_cast<Eigen::Index>(infos_.size()));
}

Eigen::VectorXd ParameterBlocks::numbers() const {
  Eigen::VectorXd out(columns());
  for (const Block& block : blocks_) {
    out.segment(block.column, block.size()) =
        Eigen::Map<const Eigen::VectorXd>(data(block), block.size());
  }
  return out;
}

void ParameterBlocks::setNumbers(const Eigen::VectorXd& numbers) {
  for (const Block& block : blocks_) {
    Eigen::Map<Eigen::VectorXd>(data(block), block.size()) =
        numbers.segment(block.column, block.size());
  }
}

double* ParameterBlocks::data(const Block& block) { return dataOf(block, values_); }
const double* ParameterBlocks::data(const Block& block) const { return dataOf(block, values_); }

}  // namespace helix_arm::estimation
