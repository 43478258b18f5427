#include "helix_arm/calibration/suspects.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <utility>
#include <variant>

#include "calibration_checks.hpp"
#include "calibration_fit.hpp"
#include "calibration_problem.hpp"
#include "helix_arm/basics/median.hpp"
#include "helix_arm/basics/pi.hpp"
#include "helix_arm/basics/text.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::estimation {
namespace {

using Poses = std::vector<PoseObservation>;
using CornersSeen = std::vector<CornerObservation>;

// A fit whose mean square is below this is as good as its noise.
constexpr double kAsNoise = 1.1;
// Share of the readings that may be wrong detections: the mean square is that of the others.
constexpr double kWrong = 0.1;
// A suspect lowers the mean square at least to this share of it, by more than chance does (gain of
// the log likelihood); to a smaller one if that is still beyond the noise, since on an arm that
// deviates in many ways every freedom explains some of it.
constexpr double kLowered = 0.91, kLoweredFar = 0.5;
// Errors that a scene may have: no mistake is smaller. Gains and scales as fractions [Pa, m, rad].
constexpr double kLeastGainError = 0.12, kLeastOffset = 12e3, kLeastTagError = 0.03;
// A single picture shows tags that are 1 mm off as tags of another size.
constexpr double kLeastTagErrorOfOne = 0.07;
constexpr double kLeastLength = 0.02, kLeastMove = 0.01, kLeastTurn = 0.02;
constexpr double kMostTurn = 2.0;  // of what was knocked; beyond it, it was put up otherwise [rad]
// The same part for captures whose pressures are outside the limits as they are.
constexpr double kLoweredInside = 1.1;
// Least share of what is beyond the noise that a suspect explains; the second of such captures,
// which are wrong in any case.
constexpr double kLeastShare = 0.3, kLeastShareInside = 0.2;
constexpr double kLeastGain = 12.0;
constexpr std::size_t kMostNamed = 5;
// All mistakes are tried with so many captures of corners, beyond one per actuator, and the best of
// them with all.
constexpr std::size_t kFewCaptures = 6, kFinalists = 12;
constexpr int kMostIterations = 30;
// A number that is fitted has to pay for itself: of two suspects that explain as much, the simpler
// one comes first.
constexpr double kPriceOfNumber = 0.03;
constexpr double kMostBorderShift = 4.0;  // in standard deviations of its prior
// Deviations beyond those of a sound arm that no good fit has.
constexpr double kFar = 5.0;
// Mean square of captures that cannot be fitted at all.
constexpr double kNoFit = 1e4;
constexpr double kFarBase = 0.3, kFarBaseTurn = 0.6;    // deviations of a base that moved [m, rad]
constexpr double kNearBase = 0.006, kNearTurn = 0.015;  // of one that is where the scene has it
constexpr double kPlace = 6;                            // numbers of it
constexpr double kScaleOfMuscle = 0.1;                  // of a muscle's length, as a fraction

// Data and options that a trial changes; both start as given.
struct Case {
  std::vector<ArmCaptures> arms;
  CalibrationOptions options;
};

// One mistake that may have been made. Some have a size, of which the best is found.
struct Trial {
  std::string cause, where;
  std::function<void(double size, Case&)> correct;
  std::function<std::string(double size, const Calibration&)> remedy;
  std::vector<double> sizes = {0.0};  // coarse grid, ascending; then halved about the best one
  double neutral = 0, least = 0;      // a size closer than this to the neutral one is no mistake
  double numbers = 0;                 // that it fits beyond the request
  bool corrects_captures = true;
  // From the tags of the scene to those on the arm, where the captures are corrected instead.
  std::function<void(TagLayout&)> place = nullptr;
  // Whether a fit without the mistake shows that it was one; null: it does.
  std::function<bool(const Calibration&)> shows = nullptr;
};

// Angle of a pose's rotation [rad].
double turnOf(const lie::SE3& pose) { return pose.log().tail<3>().norm(); }

// For noise alone, the mean square of the readings without the largest tenth, each of so many
// residuals (chi-square, within 1 %).
double trimmedSquare(int residuals) { return 1 - 0.38 * std::pow(residuals, -0.55); }

struct Square {
  double mean;    // in expected variances, without the share that may be wrong: 1 for noise
  int residuals;  // in all
  double border_shift = 0;  // [m]
  double moved = 0;     // half the square of the base's motion, in deviations of a rig that moved
  double usual = 1;     // mean square of a sound arm, if asked for
  lie::SE3 base = {};   // from where the scene has it
  double tag_turn = 0;  // of the placement that is turned farthest [rad]
  std::map<int, double> of_tag = {};  // of the first arm: medians, by the index in the layout
};

// Takes all pressures as within their limits. @return how far beyond these the farthest was [Pa].
double clampPressures(std::vector<ArmCaptures>& arms) {
  double farthest = 0;
  for (ArmCaptures& arm : arms) {
    for (Capture& capture : arm.captures) {
      const Eigen::VectorXd inside = arm.arm.clamped(capture.pressure);
      farthest = std::max(farthest, (inside - capture.pressure).cwiseAbs().maxCoeff());
      capture.pressure = inside;
    }
  }
  return farthest;
}

// Some captures of each arm, evenly spaced.
std::vector<ArmCaptures> fewOf(std::vector<ArmCaptures> arms) {
  for (ArmCaptures& arm : arms) {
    const std::size_t count = arm.captures.size();
    const std::size_t few =
        std::min(count, kFewCaptures + static_cast<std::size_t>(arm.arm.actuatorCount()));
    for (std::size_t k = 0; k < few; ++k) arm.captures[k] = arm.captures[k * count / few];
    arm.captures.resize(few, arm.captures.front());
  }
  return arms;
}

// Fits the requested parameters; nothing if no fit is possible.
class TrialFits {
 public:
  // @param rough  ends each fit once its noise is known.
  TrialFits(const CalibrationOptions& options, const std::function<bool()>& stop, bool rough)
      : options_(options), stop_(stop), rough_(rough) {
    options_.errors = options_.held_out = false;
  }

  bool stopped() const { return stop_ && stop_(); }

  // Pressures far beyond the limits are refused, or taken as at them.
  // @param usual  whether to ask for Square::usual as well.
  std::optional<Square> of(Case& one, bool clamp = false, bool usual = false) const {
    if (stopped()) return std::nullopt;
    if (clampPressures(one.arms) > kBeyondLimit && !clamp) return std::nullopt;
    const std::vector<ArmCaptures> read = withReadings(one.arms);
    if (unsound(read)) return std::nullopt;
    const ReadingKind kind = kindOf(firstReading(read));
    if (unfit(read, one.options, kind)) return std::nullopt;
    // A base that is off by as much as a tape measure is nobody's mistake.
    if (!rough_ && !one.options.base && read.size() == 1 &&
        (kind == ReadingKind::kCorners || kind == ReadingKind::kPoses)) {
      CalibrationOptions near = one.options;
      near.base = true;
      const std::optional<Square> found = fitted(read, near, usual);
      if (found && found->base.translation.norm() < kNearBase && turnOf(found->base) < kNearTurn) {
        return found;
      }
    }
    return fitted(read, one.options, usual);
  }

  const CalibrationOptions& options() const { return options_; }

 private:
  std::optional<Square> fitted(const std::vector<ArmCaptures>& read, CalibrationOptions options,
                               bool usual) const {
    // A fit that takes more is no good fit.
    options.max_iterations = std::min(options.max_iterations, kMostIterations);
    CalibrationProblem problem(read, options, selectionOf(options));
    if (!solveWithNoise(problem, 0, rough_).determined) return std::nullopt;
    std::vector<double> squares;
    std::map<int, std::vector<double>> by_tag;
    int residuals = 0;
    for (const Comparison& reading : problem.compare(1.0, false)) {
      squares.push_back(reading.square / reading.residuals / trimmedSquare(reading.residuals));
      residuals += reading.residuals;
      const bool of_tag = reading.tag >= 0 && problem.armOf(reading.capture) == 0;
      if (of_tag) by_tag[reading.tag].push_back(squares.back());
    }
    std::sort(squares.begin(), squares.end());
    squares.resize(squares.size() - static_cast<std::size_t>(kWrong * squares.size()));
    const double mean =
        std::accumulate(squares.begin(), squares.end(), 0.0) / static_cast<double>(squares.size());
    if (!std::isfinite(mean)) return std::nullopt;
    const lie::SE3 base = problem.base();
    const double far = base.translation.norm() / kFarBase;
    const double turned = turnOf(base) / kFarBaseTurn;
    const double scale = usual ? usualScale(read, options, problem) : 1.0;
    const double border_shift = problem.values().own_blocks.at(ParameterBlock::kBorderShift)[0];
    const double moved = 0.5 * (far * far + turned * turned);
    Square out{mean, residuals, border_shift, moved, scale * scale, base};
    for (auto& [tag, all] : by_tag) out.of_tag[tag] = basics::medianOf(std::move(all));
    for (const lie::Vector6& tag : problem.values().tags) {
      out.tag_turn = std::max(out.tag_turn, tag.tail<3>().norm());
    }
    return out;
  }

  CalibrationOptions options_;
  std::function<bool()> stop_;
  bool rough_;
};

void changePressures(Case& one, const std::function<void(Eigen::VectorXd&)>& change) {
  for (Capture& capture : one.arms.front().captures) change(capture.pressure);
}

template <class Observations, class Change>
void changeObservations(Case& one, const Change& change) {
  for (Capture& capture : one.arms.front().captures) {
    if (auto* seen = std::get_if<Observations>(&capture.reading)) {
      for (auto& observation : *seen) change(observation);
    }
  }
}

// 0, 1, ..
Eigen::VectorXi inOrder(int count) { return Eigen::VectorXi::LinSpaced(count, 0, count - 1); }

// A remedy that no fit changes.
auto always(std::string remedy) {
  return [remedy = std::move(remedy)](double, const Calibration&) { return remedy; };
}

// ---- Pressures ----

void addExchanges(const model::Arm& arm, std::vector<Trial>& trials) {
  const auto add = [&](const Eigen::VectorXi& from, const std::string& where) {
    const auto exchange = [from](double, Case& one) {
      changePressures(one, [&](Eigen::VectorXd& pressure) { pressure = pressure(from).eval(); });
    };
    trials.push_back(
        {"channels_exchanged", where, exchange,
         always("exchange the hoses at the regulator, or their channels in the scene")});
  };
  const Eigen::VectorXi same = inOrder(arm.actuatorCount());
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    for (int j = i + 1; j < arm.actuatorCount(); ++j) {
      Eigen::VectorXi from = same;
      std::swap(from[i], from[j]);
      add(from, arm.actuator(i).name + " and " + arm.actuator(j).name);
    }
  }
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const int first = arm.firstActuator(k), count = arm.firstActuator(k + 1) - first;
    for (int turn = 1; turn < count && count > 2; ++turn) {
      Eigen::VectorXi from = same;
      std::vector<std::string> names;
      for (int i = 0; i < count; ++i) {
        from[first + i] = first + (i + turn) % count;
        names.push_back(arm.actuator(from[first + i]).name);
      }
      add(from, "section " + std::to_string(k + 1) + ", in the order " + basics::joined(names));
    }
  }
}

// @param channel  -1: all.
void addGains(const model::Arm& arm, int channel, std::vector<Trial>& trials) {
  const bool all = channel < 0;
  const std::string where = all ? "all channels" : arm.actuator(channel).name;
  const int first = std::max(channel, 0), count = all ? arm.actuatorCount() : 1;
  const auto apply = [first, count](double gain, double offset, Case& one) {
    changePressures(one, [&](Eigen::VectorXd& pressure) {
      pressure.segment(first, count) = gain * pressure.segment(first, count).array() + offset;
    });
  };
  const auto scale = [apply](double gain, Case& one) { apply(gain, 0.0, one); };
  const auto scaled = [](double gain, const Calibration&) {
    return text("the pressure in the muscle is ", std::round(100 * gain),
                " % of what is read: look for a leak, and check the scale of the sensor and of "
                "the regulator");
  };
  const auto shift = [apply](double offset, Case& one) { apply(1.0, offset, one); };
  const auto shifted = [](double offset, const Calibration&) {
    return text("the pressure in the muscle is ", std::round(std::abs(offset) / 1e3), " kPa ",
                offset > 0 ? "above" : "below",
                " what is read: zero the sensor with the muscle vented");
  };
  const std::vector<double> gains{0.35, 0.5, 0.7, 0.9, 1.15, 1.4, 2.0, 2.8};
  const std::vector<double> offsets{-80e3, -40e3, -20e3, 20e3, 40e3, 80e3};
  trials.push_back({"pressure_gain", where, scale, scaled, gains, 1.0, kLeastGainError, 1});
  trials.push_back({"pressure_offset", where, shift, shifted, offsets, 0.0, kLeastOffset, 1});
  if (all) return;
  const double vented = std::max(0.0, arm.actuator(channel).limits.lower);
  trials.push_back(
      {"channel_dead", where, [apply, vented](double, Case& one) { apply(0.0, vented, one); },
       always("no pressure reaches the muscle: check its hose, its valve and its channel")});
}

void addUnits(std::vector<Trial>& trials) {
  // Factors on what was read as kPa.
  static constexpr std::pair<const char*, double> kUnits[] = {
      {"psi", 6.894757}, {"bar", 100.0}, {"mbar", 0.1}, {"Pa", 1e-3}};
  for (const auto& [unit, factor] : kUnits) {
    const auto convert = [factor = factor](double, Case& one) {
      changePressures(one, [&](Eigen::VectorXd& read) { read *= factor; });
    };
    trials.push_back({"pressure_unit", std::string("all channels in ") + unit, convert,
                      always(text("the pressures are in ", unit,
                                  ": convert them, and name their unit in the header"))});
  }
}

// ---- Tags and pictures ----

// Tags at one place along the arm, around it, or others that belong together.
struct Row {
  Eigen::VectorXi tags;  // indices in the layout, by their angle about the arm
  std::string name;
};

Row rowOf(const TagLayout& layout, const std::vector<int>& tags) {
  Row row{Eigen::Map<const Eigen::VectorXi>(tags.data(), static_cast<Eigen::Index>(tags.size())),
          ""};
  std::vector<std::string> ids;
  for (const int tag : tags) {
    ids.push_back(std::to_string(layout.tags[static_cast<std::size_t>(tag)].id));
  }
  row.name = (ids.size() == 1 ? "tag " : "tags ") + basics::joined(ids);
  return row;
}

std::vector<Row> rowsOf(const TagLayout& layout) {
  constexpr double kSamePlace = 0.01;  // of a section
  std::map<long, std::vector<std::pair<double, int>>> by_place;
  for (std::size_t i = 0; i < layout.tags.size(); ++i) {
    const TagPlacement& tag = layout.tags[i];
    const Eigen::Vector3d& at = tag.X_ST.translation;
    by_place[std::lround((tag.section + tag.s) / kSamePlace)].emplace_back(
        std::atan2(at.z(), at.y()), static_cast<int>(i));
  }
  std::vector<Row> rows;
  for (auto& [place, tags] : by_place) {
    std::sort(tags.begin(), tags.end());
    std::vector<int> around;
    for (const auto& [angle, tag] : tags) around.push_back(tag);
    rows.push_back(rowOf(layout, around));
  }
  return rows;
}

// Tags along each section, as along a muscle: each follows the one before at nearly its angle about
// the arm. Without those that are alone, or all tags.
std::vector<Row> stripsOf(const TagLayout& layout) {
  constexpr double kSameStrip = 0.9;  // cosine of the angle from one tag to the next
  const auto at = [&layout](int tag) -> const TagPlacement& {
    return layout.tags[static_cast<std::size_t>(tag)];
  };
  std::vector<int> along(layout.tags.size());
  std::iota(along.begin(), along.end(), 0);
  std::stable_sort(along.begin(), along.end(), [&](int a, int b) { return at(a).s < at(b).s; });
  std::vector<std::vector<int>> strips;
  for (const int tag : along) {
    const auto strip = std::find_if(strips.begin(), strips.end(), [&](const auto& tags) {
      const TagPlacement &last = at(tags.back()), &next = at(tag);
      const Eigen::Vector2d a = last.X_ST.translation.tail<2>(),
                            b = next.X_ST.translation.tail<2>();
      return last.section == next.section && last.s < next.s &&
             a.dot(b) > kSameStrip * a.norm() * b.norm();
    });
    if (strip == strips.end()) {
      strips.push_back({tag});
    } else {
      strip->push_back(tag);
    }
  }
  std::vector<Row> out;
  for (const std::vector<int>& strip : strips) {
    if (strip.size() > 1 && strip.size() < along.size()) out.push_back(rowOf(layout, strip));
  }
  return out;
}

// The tags that are where the scene has tags 0, 1, ..; and the quarter turns of each place.
struct Places {
  explicit Places(const TagLayout& layout)
      : tag(inOrder(static_cast<int>(layout.tags.size()))), quarters(0 * tag) {}

  void exchange(const Row& a, const Row& b) {
    tag(a.tags) = b.tags;
    tag(b.tags) = a.tags;
  }

  Eigen::VectorXi tag, quarters;
};

// About the normal of a tag, counterclockwise as one reads it.
void turnTag(int quarters, Eigen::Matrix3d& rotation) {
  if (quarters == 0) return;
  rotation *=
      Eigen::AngleAxisd(0.5 * basics::kPi * quarters, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

void addTagTrial(const std::string& cause, const std::string& where, const Places& places,
                 const std::string& remedy, std::vector<Trial>& trials) {
  const auto correct = [places](double, Case& one) {
    changeObservations<Poses>(one, [&](PoseObservation& seen) {
      turnTag(-places.quarters[seen.tag], seen.X_BT.rotation);
      seen.tag = places.tag[seen.tag];
    });
    changeObservations<CornersSeen>(one, [&](CornerObservation& seen) {
      const Corners read = seen.direction;
      const int first = 4 - places.quarters[seen.tag];
      for (int i = 0; i < 4; ++i) seen.direction.col(i) = read.col((i + first) % 4);
      seen.tag = places.tag[seen.tag];
    });
  };
  trials.push_back({cause, where, correct, always(remedy)});
  trials.back().place = [places](TagLayout& layout) {
    const std::vector<TagPlacement> before = layout.tags;
    for (std::size_t i = 0; i < before.size(); ++i) {
      const auto here = static_cast<Eigen::Index>(i);
      layout.tags[i] = before[static_cast<std::size_t>(places.tag[here])];
      layout.tags[i].id = before[i].id;
      turnTag(places.quarters[here], layout.tags[i].X_ST.rotation);
    }
  };
}

void addRowTrials(const TagLayout& layout, std::vector<Trial>& trials) {
  const std::vector<Row> rows = rowsOf(layout);
  for (std::size_t a = 0; a < rows.size(); ++a) {
    for (std::size_t b = a + 1; b < rows.size(); ++b) {
      if (rows[a].tags.size() != rows[b].tags.size()) continue;
      Places places(layout);
      places.exchange(rows[a], rows[b]);
      addTagTrial("tag_rows_exchanged", rows[a].name + " and " + rows[b].name, places,
                  "exchange them in the scene's tags, or on the arm", trials);
    }
  }
  Places reversed(layout), mirrored(layout);
  bool reversible = rows.size() > 2, mirrors = false;
  for (std::size_t a = 0; a < rows.size(); ++a) {
    const Row& row = rows[a];
    const Row& other = rows[rows.size() - 1 - a];
    reversible = reversible && row.tags.size() == other.tags.size();
    if (reversible) reversed.exchange(row, other);
    mirrors = mirrors || row.tags.size() > 2;
    mirrored.tag(row.tags) = row.tags.reverse();
  }
  if (reversible) {
    addTagTrial("tag_rows_reversed", "all tags", reversed,
                "the rows are counted from the tip: number them from the base in the scene",
                trials);
  }
  if (mirrors) {
    addTagTrial("tags_mirrored", "all tags", mirrored,
                "the tags of each row are in the other order around the arm: turn it in the scene",
                trials);
  }
}

void addTurnsOf(const Row& row, const TagLayout& layout, std::vector<Trial>& trials) {
  for (int quarters = 1; quarters < 4; ++quarters) {
    Places places(layout);
    places.quarters(row.tags).setConstant(quarters);
    addTagTrial("tags_turned", row.name, places,
                text("they are glued turned by ", 90 * quarters,
                     " degrees counterclockwise: turn them in the scene's tags, or on the arm"),
                trials);
  }
}

std::set<int> seenTags(const ArmCaptures& arm) {
  std::set<int> out;
  for (const Capture& capture : arm.captures) {
    const auto add = [&out](const auto* seen) {
      for (std::size_t i = 0; seen != nullptr && i < seen->size(); ++i) out.insert((*seen)[i].tag);
    };
    add(std::get_if<Poses>(&capture.reading));
    add(std::get_if<CornersSeen>(&capture.reading));
  }
  return out;
}

void addTurns(const ArmCaptures& arm, ReadingKind kind, const CalibrationOptions& options,
              std::vector<Trial>& trials) {
  const TagLayout& layout = arm.layout;
  // Positions alone do not show how a tag is turned.
  if (kind == ReadingKind::kPoses && options.rotation_noise == 0) return;
  std::vector<Row> rows = rowsOf(layout);
  if (rows.size() > 1) rows.push_back({Places(layout).tag, "all tags"});
  for (Row& strip : stripsOf(layout)) rows.push_back(std::move(strip));
  // Ring and strip of the only tag that is seen of them are the same trial, of this tag.
  const std::set<int> seen = seenTags(arm);
  std::set<std::string> names;
  for (Row& row : rows) {
    std::vector<int> shown;
    for (const int tag : row.tags) {
      if (seen.count(tag) > 0) shown.push_back(tag);
    }
    if (shown.size() == 1) row = rowOf(layout, shown);
    if (!shown.empty() && names.insert(row.name).second) addTurnsOf(row, layout, trials);
  }
}

// As pictures show the corners that were read on pictures of another size, or turned by 180
// degrees.
void changePixels(Case& one, const std::function<Eigen::Vector2d(const Eigen::Vector2d&)>& change) {
  const Camera& camera = one.arms.front().camera;
  changeObservations<CornersSeen>(one, [&](CornerObservation& seen) {
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector2d pixel = change(camera.pixelOf(seen.direction.col(i)));
      // Where the distortion cannot be inverted, the picture shows nothing.
      seen.direction.col(i) = camera.directionOf(pixel).value_or(seen.direction.col(i));
    }
  });
}

void addPictureTrials(const ArmCaptures& arm, std::vector<Trial>& trials) {
  const Camera& camera = arm.camera;
  for (const int side : {320, 640, 800, 1024, 1280, 1600, 1920, 2560, 3840}) {
    if (side == camera.width) continue;
    const auto scale = [factor = static_cast<double>(camera.width) / side](double, Case& one) {
      // Pixel (0, 0) is the centre of the first one.
      const Eigen::Vector2d half(0.5, 0.5);
      changePixels(one, [&](const Eigen::Vector2d& pixel) {
        return Eigen::Vector2d(factor * (pixel + half) - half);
      });
      // The noise is of the picture as it is.
      one.options.corner_noise *= factor;
      one.options.corner_floor *= factor;
    };
    trials.push_back(
        {"picture_size", "the camera", scale,
         always(text("the pictures are ", side,
                     " pixels wide, those that the camera was calibrated at ", camera.width,
                     ": take them at that size, or calibrate the camera at this one"))});
  }
  const Eigen::Vector2d last(camera.width - 1, camera.height - 1);
  const auto turn = [last](double, Case& one) {
    changePixels(one, [&](const Eigen::Vector2d& pixel) { return Eigen::Vector2d(last - pixel); });
  };
  trials.push_back({"picture_turned", "the camera", turn,
                    always("the pictures are upside down: turn the camera, or its pictures")});
  const auto resize = [](double factor, Case& one) { one.arms.front().layout.size *= factor; };
  const auto resized = [](double, const Calibration& fit) {
    return text("write tags.size_m: ", std::round(1e5 * fit.layout.size) / 1e5,
                " into the scene, measured over the outer edge of the black border (of families "
                "Circle, Custom and Standard over its inner edge, around the white square)");
  };
  const std::vector<double> factors{0.6, 0.8, 1.25, 1.6};
  const double least = arm.captures.size() == 1 ? kLeastTagErrorOfOne : kLeastTagError;
  trials.push_back({"tag_size", "all tags", resize, resized, factors, 1.0, least, 1, false});
}

// ---- The rig ----

double usualOf(const Eigen::VectorXd& scales) {
  return basics::medianOf(std::vector<double>(scales.begin(), scales.end()));
}

// The muscle whose length differs most from the others'.
int oddMuscle(const Eigen::VectorXd& scales) {
  int odd = 0;
  (scales.array() - usualOf(scales)).abs().maxCoeff(&odd);
  return odd;
}

void addMove(bool corners, std::vector<Trial>& trials) {
  const auto release = [](double, Case& one) {
    one.options.base = true;
    one.options.base_prior = {kFarBase, kFarBaseTurn};
  };
  const auto remedy = [](double, const Calibration& fit) {
    return text("it is ", std::round(1e3 * fit.X_B0B.translation.norm()), " mm and ",
                std::round(turnOf(fit.X_B0B) * 1800 / basics::kPi) / 10,
                " degrees from where the scene has it: fit base as well");
  };
  const auto shows = [](const Calibration& fit) {
    const double turn = turnOf(fit.X_B0B);
    return turn < kMostTurn && (turn > kLeastTurn || fit.X_B0B.translation.norm() > kLeastMove);
  };
  const std::string cause = corners ? "camera_moved" : "base_moved";
  const std::string where = corners ? "the camera" : "the base";
  trials.push_back({cause, where, release, remedy, {0.0}, 0, 0, kPlace, false, nullptr, shows});
}

void addLengths(const model::Arm& arm, std::vector<Trial>& trials) {
  const auto release = [](double, Case& one) {
    one.options.length_scale = LengthScaling::kEach;
    one.options.length_scale_prior = kScaleOfMuscle;
  };
  const auto remedy = [arm](double, const Calibration& fit) {
    std::string out = "the muscles are";
    for (int i = 0; i < arm.actuatorCount(); ++i) {
      out += text(i > 0 ? ", " : " ", arm.actuator(i).name, " ",
                  std::round(1e3 * fit.length_scale[i]) / 10, " %");
    }
    return out + " of the length in the scene: fit length_scale_each as well";
  };
  const auto shows = [](const Calibration& fit) {
    const double odd = fit.length_scale[oddMuscle(fit.length_scale)];
    return std::abs(odd - usualOf(fit.length_scale)) > kLeastLength;
  };
  const double numbers = arm.actuatorCount();
  trials.push_back(
      {"muscle_length", "", release, remedy, {0.0}, 0, 0, numbers, false, nullptr, shows});
}

void addLoads(std::vector<Trial>& trials) {
  for (const double factor : {-1.0, 0.0}) {
    trials.push_back(
        {"load", "gravity",
         [factor](double, Case& one) { one.arms.front().load->gravity *= factor; },
         always(factor < 0
                    ? "it points the other way: turn load.gravity or the base in the scene"
                    : "the arm hangs from nothing: leave its weight out of the scene's load")});
    trials.back().corrects_captures = false;
  }
}

std::vector<Trial> trialsFor(const ArmCaptures& arm, const CalibrationOptions& options,
                             ReadingKind kind) {
  std::vector<Trial> trials;
  // Shapes that are free follow any pressures.
  if (!options.free_shapes) {
    addExchanges(arm.arm, trials);
    addUnits(trials);
    for (int i = -1; i < arm.arm.actuatorCount(); ++i) addGains(arm.arm, i, trials);
  }
  const bool corners = kind == ReadingKind::kCorners, tags = corners || kind == ReadingKind::kPoses;
  if (tags) {
    addRowTrials(arm.layout, trials);
    addTurns(arm, kind, options, trials);
  }
  if (corners) addPictureTrials(arm, trials);
  if (tags && !options.base) addMove(corners, trials);
  if (options.free_shapes) return trials;
  if (options.length_scale != LengthScaling::kEach && !options.contraction) {
    addLengths(arm.arm, trials);
  }
  if (arm.isLoaded()) addLoads(trials);
  return trials;
}

// A trial of some size, and its residual.
struct Found {
  double size = 0, residual = 0, price = 1;
  const Trial* trial = nullptr;
};

// Nothing if it cannot be fitted.
std::optional<Found> tried(const Trial& trial, double size, const std::vector<ArmCaptures>& arms,
                           const TrialFits& fits) {
  Case one{arms, fits.options()};
  trial.correct(size, one);
  const std::optional<Square> square = fits.of(one, trial.sizes.size() > 1);
  if (!square) return std::nullopt;
  return Found{size, square->mean, 1 + kPriceOfNumber * (trial.numbers + square->moved), &trial};
}

// At its best size.
std::optional<Found> best(const Trial& trial, const std::vector<ArmCaptures>& arms,
                          const TrialFits& fits) {
  std::map<double, Found> known;
  const auto at = [&](double size) {
    if (const auto found = tried(trial, size, arms, fits)) known.emplace(size, *found);
  };
  const auto least = [&] {
    return std::min_element(known.begin(), known.end(), [](const auto& a, const auto& b) {
      return a.second.residual < b.second.residual;
    });
  };
  for (const double size : trial.sizes) at(size);
  if (known.empty()) return std::nullopt;
  // The bracket of the best one is halved from both sides.
  constexpr int kHalvings = 5;
  for (int round = 0; round < kHalvings && trial.sizes.size() > 1; ++round) {
    const auto here = least();
    if (here != known.begin()) at(0.5 * (here->first + std::prev(here)->first));
    if (std::next(here) != known.end()) at(0.5 * (here->first + std::next(here)->first));
  }
  return least()->second;
}

// The best trials, the best one first: all with some captures, then these with all.
std::vector<Found> bestOf(const std::vector<Trial>& trials, const std::vector<ArmCaptures>& read,
                          const TrialFits& rough, const TrialFits& fits) {
  std::vector<Found> found, out;
  const auto sort = [](std::vector<Found>& all) {
    std::stable_sort(all.begin(), all.end(), [](const Found& a, const Found& b) {
      return a.price * a.residual < b.price * b.residual;
    });
  };
  const bool corners = kindOf(firstReading(read)) == ReadingKind::kCorners;
  const std::vector<ArmCaptures> few = corners ? fewOf(read) : read;
  for (const Trial& trial : trials) {
    if (const std::optional<Found> one = best(trial, few, rough)) found.push_back(*one);
  }
  sort(found);
  for (const Found& one : found) {
    if (out.size() == kFinalists) break;
    if (const auto all = tried(*one.trial, one.size, read, fits)) out.push_back(*all);
  }
  sort(out);
  return out;
}

// Whether a pressure is far beyond its limits; nothing if captures and arm do not belong together.
std::optional<bool> isOutside(std::vector<ArmCaptures> arms) {
  for (const ArmCaptures& arm : arms) {
    for (const Capture& capture : arm.captures) {
      if (capture.pressure.size() != arm.arm.actuatorCount()) return std::nullopt;
    }
  }
  const double beyond = clampPressures(arms);
  if (unsound(arms)) return std::nullopt;
  return beyond > kBeyondLimit;
}

// How well the request fits the readings as they are.
struct Evidence {
  const std::vector<ArmCaptures>& read;
  Square before;
  bool inside;  // all pressures are within their limits
};

// The suspect of a trial that explains so much; nothing if its fit shows no mistake.
std::optional<Suspect> shown(const Found& one, double explains, const Evidence& evidence,
                             const TrialFits& fits) {
  const Trial& trial = *one.trial;
  Case corrected{evidence.read, fits.options()};
  trial.correct(one.size, corrected);
  clampPressures(corrected.arms);
  const Calibration fit = calibrate(corrected.arms, corrected.options);
  if (fit.shapes.empty()) return std::nullopt;  // refused
  if (trial.shows && !trial.shows(fit)) return std::nullopt;
  const model::Arm& arm = evidence.read.front().arm;
  const std::string where =
      trial.where.empty() ? arm.actuator(oddMuscle(fit.length_scale)).name : trial.where;
  Suspect suspect{trial.cause, where, explains, trial.remedy(one.size, fit), {}, {}};
  if (trial.cause.rfind("tag", 0) == 0) suspect.layout = corrected.arms.front().layout;
  if (trial.place) trial.place(*suspect.layout);
  if (trial.corrects_captures) suspect.corrected = std::move(corrected.arms);
  return suspect;
}

// The suspect of a trial; nothing if it explains too little, or is too small for a mistake.
std::optional<Suspect> named(const Found& one, const Evidence& evidence, const TrialFits& fits) {
  const Trial& trial = *one.trial;
  const Square& before = evidence.before;
  if (std::abs(one.size - trial.neutral) < trial.least) return std::nullopt;
  const double lowered = one.price * one.residual / before.mean;
  const double gain = -0.5 * before.residuals * std::log(lowered);
  // Pressures outside the limits are wrong, however little that shows.
  const double most = !evidence.inside          ? kLoweredInside
                      : one.residual < kAsNoise ? kLowered
                                                : kLoweredFar;
  if (lowered > most || (evidence.inside && gain < kLeastGain)) return std::nullopt;
  const double beyond = before.mean - std::min(1.0, one.residual);
  const double explains = beyond > 0 ? (before.mean - one.residual) / beyond : 0;
  if (explains < (evidence.inside ? kLeastShare : kLeastShareInside)) return std::nullopt;
  return shown(one, explains, evidence, fits);
}

// Tags that are turned alone, which the mean square leaves out: no capture fits them until they
// are.
std::vector<Suspect> turnedAlone(const Evidence& evidence, const TrialFits& fits) {
  constexpr std::size_t kMost = 3;
  const ArmCaptures& arm = evidence.read.front();
  const double far = kFar * kFar * evidence.before.usual;
  std::vector<int> odd;
  for (const auto& [tag, square] : evidence.before.of_tag) {
    if (square > far) odd.push_back(tag);
  }
  std::vector<Suspect> out;
  if (odd.size() > kMost) return {};
  for (const int tag : odd) {
    std::vector<Trial> trials;
    addTurnsOf(rowOf(arm.layout, {tag}), arm.layout, trials);
    for (const Trial& trial : trials) {
      Case one{evidence.read, fits.options()};
      trial.correct(0, one);
      const std::optional<Square> after = fits.of(one);
      if (!after || after->of_tag.at(tag) > far) continue;
      const double before = evidence.before.of_tag.at(tag), left = after->of_tag.at(tag);
      const double explains = (before - left) / (before - std::min(1.0, left));
      if (auto suspect = shown({0, after->mean, 1, &trial}, explains, evidence, fits)) {
        out.push_back(*suspect);
      }
    }
  }
  return out;
}

// The suspects of all trials, the best first.
std::vector<Suspect> namedOf(const std::vector<Found>& found, const Evidence& evidence,
                             const TrialFits& fits) {
  std::vector<Suspect> out;
  double least = evidence.inside ? evidence.before.mean : 0.0;
  for (const Found& one : found) {
    if (fits.stopped()) return {};
    if (out.size() == kMostNamed) break;
    if (std::optional<Suspect> suspect = named(one, evidence, fits)) {
      least = std::min(least, one.residual);
      out.push_back(*suspect);
    }
  }
  // No single mistake brings the readings near to this arm.
  if (least > kFar * kFar * evidence.before.usual) {
    const std::string remedy =
        "no single mistake explains them: check that captures and scene are of the same arm, and "
        "look for several mistakes";
    out.insert(out.begin(), {"other_arm", "all captures", 0.0, remedy, {}, {}});
    if (out.size() > kMostNamed) out.pop_back();
  }
  return out;
}

}  // namespace

bool isCertain(const std::vector<Suspect>& suspects, double noise) {
  constexpr double kCertain = 0.9, kCertainFar = 0.5;
  const double least = noise > kFarNoise ? kCertainFar : kCertain;
  return std::any_of(suspects.begin(), suspects.end(),
                     [least](const Suspect& one) { return one.explains >= least; });
}

std::vector<Suspect> suspectsOf(const std::vector<ArmCaptures>& arms,
                                const CalibrationOptions& options,
                                const std::function<bool()>& stop) {
  options.validate();
  const std::vector<ArmCaptures> read = withReadings(arms);
  if (read.empty() || read.front().captures.empty()) return {};
  const std::optional<bool> outside = isOutside(read);
  if (!outside) return {};
  TrialFits fits(options, stop, false);
  Case given{read, fits.options()};
  const std::optional<Square> fitted = fits.of(given, true, true);
  // Data that cannot be fitted for another reason than its pressures has no suspects.
  if (!fitted && !*outside) return {};
  Evidence evidence{read, fitted.value_or(Square{kNoFit, static_cast<int>(kNoFit)}),
                    fitted && !*outside};
  // A wrong tag size is taken up by the bleeding, and a tag that is glued otherwise by its
  // placement, as far as they are fitted.
  const bool placed = options.tags && (evidence.before.mean > kFar * kFar ||
                                       evidence.before.tag_turn > 0.25 * basics::kPi);
  if (placed ||
      std::abs(evidence.before.border_shift) > kMostBorderShift * options.border_shift_prior) {
    given.options.border_shift = false;
    given.options.tags = options.tags && !placed;
    given.options.base = options.base || (placed && options.free_shapes);
    fits = TrialFits(given.options, stop, false);
    evidence.before = fits.of(given, true, true).value_or(evidence.before);
  }
  const auto alone = [&] { return turnedAlone(evidence, fits); };
  if (evidence.inside && evidence.before.mean < kAsNoise) return alone();
  const std::vector<Trial> trials = trialsFor(read.front(), options, kindOf(firstReading(read)));
  const std::vector<Found> found =
      bestOf(trials, read, TrialFits(fits.options(), stop, true), fits);
  std::vector<Suspect> out = namedOf(found, evidence, fits);
  return out.empty() ? alone() : out;
}

}  // namespace helix_arm::estimation
