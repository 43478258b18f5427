#include "helix_arm/calibration/suspects.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
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
// What a scene may be off by: no mistake is smaller. Gains and scales as fractions [Pa, m, rad].
constexpr double kLeastGainError = 0.12, kLeastOffset = 12e3, kLeastTagError = 0.03;
constexpr double kLeastLength = 0.02, kLeastMove = 0.01, kLeastTurn = 0.02;
// Of captures whose pressures are outside the limits as they are.
constexpr double kLoweredInside = 1.1;
// Least share of what is beyond the noise that a suspect explains.
constexpr double kLeastShare = 0.3;
constexpr double kLeastGain = 12.0;
constexpr std::size_t kMostNamed = 5;
// A number that is fitted has to pay for itself: of two suspects that explain as much, the simpler
// one comes first.
constexpr double kPriceOfNumber = 0.03;
constexpr double kMostBleed = 4.0;  // in standard deviations of its prior
// Deviations beyond those of a sound arm that no good fit has.
constexpr double kFar = 5.0;
// Mean square of captures that cannot be fitted at all.
constexpr double kNoFit = 1e4;
constexpr double kFarBase = 0.3, kFarBaseTurn = 0.6;    // deviations of a base that moved [m, rad]
constexpr double kNearBase = 0.006, kNearTurn = 0.015;  // of one that is where the scene has it
constexpr int kPlace = 6;                               // numbers of it
constexpr double kScaleOfMuscle = 0.1;                  // of a muscle's length, as a fraction
constexpr double kMillimetres = 1e3;

// What a trial changes; both start as given.
struct Case {
  std::vector<ArmCaptures> arms;
  CalibrationOptions options;
};

constexpr auto kSamePlaces = [](TagLayout&) {};

// One mistake that may have been made. Some have a size, of which the best is found.
struct Trial {
  std::string cause, where;
  std::function<void(double size, Case&)> correct;
  std::function<std::string(double size, const Calibration&)> remedy;
  std::vector<double> sizes = {0.0};  // coarse grid, ascending; then halved about the best one
  bool corrects_captures = true;
  double numbers = 0;  // that it fits beyond the request
  // From the tags of the scene to those on the arm, where the captures are corrected instead.
  std::function<void(TagLayout&)> place = kSamePlaces;
  double neutral = 0, least = -1;  // a size closer than this to the neutral one is no mistake
  // Whether a fit without the mistake shows that it was one; null: it does.
  std::function<bool(const Calibration&)> shows = nullptr;
};

// Of noise alone, the mean square of the readings without the largest tenth, each of so many
// residuals (chi-square, within 1 %).
double trimmedSquare(int residuals) { return 1 - 0.38 * std::pow(residuals, -0.55); }

struct Square {
  double mean;       // in expected variances, without the share that may be wrong: 1 for noise
  int residuals;     // in all
  double bleed = 0;  // [m]
  double moved = 0;  // half the square of the base's motion, in deviations of a rig that moved
  double usual = 1;  // mean square of a sound arm, if asked for
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

// Fits the requested parameters; nothing if no fit is possible.
class Misfit {
 public:
  Misfit(const CalibrationOptions& options, const std::function<bool()>& stop)
      : options_(options), stop_(stop) {
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
    // What a base takes up that is off by as much as a tape measure is nobody's mistake.
    if (!one.options.base && read.size() == 1 &&
        (kind == ReadingKind::kCorners || kind == ReadingKind::kPoses)) {
      CalibrationOptions near = one.options;
      near.base = true;
      lie::SE3 base;
      const std::optional<Square> found = fitted(read, near, usual, base);
      if (found && base.translation.norm() < kNearBase && base.log().tail<3>().norm() < kNearTurn) {
        return found;
      }
    }
    lie::SE3 base;
    return fitted(read, one.options, usual, base);
  }

  const CalibrationOptions& options() const { return options_; }

 private:
  static std::optional<Square> fitted(const std::vector<ArmCaptures>& read,
                                      const CalibrationOptions& options, bool usual,
                                      lie::SE3& base) {
    CalibrationProblem problem(read, options, selectionOf(options));
    if (!solveWithNoise(problem, 0).converged) return std::nullopt;
    std::vector<double> squares;
    int residuals = 0;
    for (const Comparison& reading : problem.compare(1.0, false)) {
      squares.push_back(reading.square / reading.residuals / trimmedSquare(reading.residuals));
      residuals += reading.residuals;
    }
    std::sort(squares.begin(), squares.end());
    squares.resize(squares.size() - static_cast<std::size_t>(kWrong * squares.size()));
    double sum = 0;
    for (const double square : squares) sum += square;
    base = problem.base();
    const double far = base.translation.norm() / kFarBase;
    const double turned = base.log().tail<3>().norm() / kFarBaseTurn;
    const double scale = usual ? usualScale(read, options, problem) : 1.0;
    return Square{sum / static_cast<double>(squares.size()), residuals,
                  problem.values().own_blocks.at(ParameterBlock::kBleed)[0],
                  0.5 * (far * far + turned * turned), scale * scale};
  }

  CalibrationOptions options_;
  std::function<bool()> stop_;
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
std::vector<int> inOrder(int count) {
  std::vector<int> out(static_cast<std::size_t>(count));
  std::iota(out.begin(), out.end(), 0);
  return out;
}

// ---- Pressures ----

void addExchanges(const model::Arm& arm, std::vector<Trial>& trials) {
  const auto remedy = [](double, const Calibration&) {
    return std::string("exchange the hoses at the regulator, or their channels in the scene");
  };
  const auto add = [&](const std::vector<int>& from, const std::string& where) {
    trials.push_back({"channels_exchanged", where,
                      [from](double, Case& one) {
                        changePressures(one, [&](Eigen::VectorXd& pressure) {
                          const Eigen::VectorXd read = pressure;
                          for (Eigen::Index i = 0; i < read.size(); ++i) {
                            pressure[i] = read[from[static_cast<std::size_t>(i)]];
                          }
                        });
                      },
                      remedy});
  };
  const std::vector<int> same = inOrder(arm.actuatorCount());
  for (int i = 0; i < arm.actuatorCount(); ++i) {
    for (int j = i + 1; j < arm.actuatorCount(); ++j) {
      std::vector<int> from = same;
      std::swap(from[static_cast<std::size_t>(i)], from[static_cast<std::size_t>(j)]);
      add(from, arm.actuator(i).name + " and " + arm.actuator(j).name);
    }
  }
  for (int k = 0; k < arm.sectionCount(); ++k) {
    const int first = arm.firstActuator(k), count = arm.firstActuator(k + 1) - first;
    for (int turn = 1; turn < count && count > 2; ++turn) {
      std::vector<int> from = same;
      std::vector<std::string> names;
      for (int i = 0; i < count; ++i) {
        from[static_cast<std::size_t>(first + i)] = first + (i + turn) % count;
        names.push_back(arm.actuator(first + (i + turn) % count).name);
      }
      add(from, "section " + std::to_string(k + 1) + ", in the order " + basics::joined(names));
    }
  }
}

// @param channel  -1: all.
void addGains(const model::Arm& arm, int channel, std::vector<Trial>& trials) {
  const bool all = channel < 0;
  const std::string where = all ? "all channels" : arm.actuator(channel).name;
  const auto apply = [channel](Case& one, const std::function<double(double)>& change) {
    changePressures(one, [&](Eigen::VectorXd& pressure) {
      for (Eigen::Index i = 0; i < pressure.size(); ++i) {
        if (channel < 0 || i == channel) pressure[i] = change(pressure[i]);
      }
    });
  };
  trials.push_back(
      {"pressure_gain",
       where,
       [apply](double gain, Case& one) { apply(one, [gain](double read) { return gain * read; }); },
       [where](double gain, const Calibration&) {
         return text("the pressure in the muscle is ", std::round(100 * gain),
                     " % of what is read: look for a leak, and check the scale of the "
                     "sensor and of the regulator");
       },
       {0.35, 0.5, 0.7, 0.9, 1.15, 1.4, 2.0, 2.8},
       true,
       1,
       kSamePlaces,
       1.0,
       kLeastGainError});
  trials.push_back({"pressure_offset",
                    where,
                    [apply](double offset, Case& one) {
                      apply(one, [offset](double read) { return read + offset; });
                    },
                    [](double offset, const Calibration&) {
                      return text("the pressure in the muscle is ",
                                  std::round(std::abs(offset) / 1e3), " kPa ",
                                  offset > 0 ? "above" : "below",
                                  " what is read: zero the sensor with the muscle vented");
                    },
                    {-80e3, -40e3, -20e3, 20e3, 40e3, 80e3},
                    true,
                    1,
                    kSamePlaces,
                    0.0,
                    kLeastOffset});
  if (all) return;
  const double vented = std::max(0.0, arm.actuator(channel).limits.lower);
  trials.push_back(
      {"channel_dead", where,
       [apply, vented](double, Case& one) { apply(one, [vented](double) { return vented; }); },
       [](double, const Calibration&) {
         return std::string(
             "no pressure reaches the muscle: check its hose, its valve and its "
             "channel");
       }});
}

void addUnits(std::vector<Trial>& trials) {
  // Factors on what was read as kPa.
  static constexpr std::pair<const char*, double> kUnits[] = {
      {"psi", 6.894757}, {"bar", 100.0}, {"mbar", 0.1}, {"Pa", 1e-3}};
  for (const auto& [unit, factor] : kUnits) {
    trials.push_back({"pressure_unit", std::string("all channels in ") + unit,
                      [factor = factor](double, Case& one) {
                        changePressures(one, [&](Eigen::VectorXd& read) { read *= factor; });
                      },
                      [unit = unit](double, const Calibration&) {
                        return text("the pressures are in ", unit,
                                    ": convert them, and name their unit in the header");
                      }});
  }
}

// ---- Tags and pictures ----

// Tags at one place along the arm, around it.
struct Row {
  std::vector<int> tags;  // indices in the layout, by their angle about the arm
  std::string name;
};

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
    Row row;
    std::vector<std::string> ids;
    for (const auto& [angle, tag] : tags) {
      row.tags.push_back(tag);
      ids.push_back(std::to_string(layout.tags[static_cast<std::size_t>(tag)].id));
    }
    row.name = (ids.size() == 1 ? "tag " : "tags ") + basics::joined(ids);
    rows.push_back(std::move(row));
  }
  return rows;
}

void addPermutation(std::string cause, std::string where, std::vector<int> to,
                    const std::string& remedy, std::vector<Trial>& trials) {
  const auto change = [to](auto& seen) { seen.tag = to[static_cast<std::size_t>(seen.tag)]; };
  const auto place = [to = std::move(to)](TagLayout& layout) {
    const std::vector<TagPlacement> before = layout.tags;
    for (std::size_t i = 0; i < before.size(); ++i) {
      layout.tags[i] = before[static_cast<std::size_t>(to[i])];
      layout.tags[i].id = before[i].id;
    }
  };
  trials.push_back({std::move(cause),
                    std::move(where),
                    [change](double, Case& one) {
                      changeObservations<Poses>(one, change);
                      changeObservations<CornersSeen>(one, change);
                    },
                    [remedy](double, const Calibration&) { return remedy; },
                    {0.0},
                    true,
                    0,
                    place});
}

void addRowTrials(const TagLayout& layout, std::vector<Trial>& trials) {
  const std::vector<Row> rows = rowsOf(layout);
  const std::vector<int> same = inOrder(static_cast<int>(layout.tags.size()));
  const auto exchange = [](const Row& a, const Row& b, std::vector<int>& to) {
    for (std::size_t i = 0; i < a.tags.size(); ++i) {
      to[static_cast<std::size_t>(a.tags[i])] = b.tags[i];
      to[static_cast<std::size_t>(b.tags[i])] = a.tags[i];
    }
  };
  const std::string remedy = "exchange them in the scene's tags, or on the arm";
  for (std::size_t a = 0; a < rows.size(); ++a) {
    for (std::size_t b = a + 1; b < rows.size(); ++b) {
      if (rows[a].tags.size() != rows[b].tags.size()) continue;
      std::vector<int> to = same;
      exchange(rows[a], rows[b], to);
      addPermutation("tag_rows_exchanged", rows[a].name + " and " + rows[b].name, to, remedy,
                     trials);
    }
  }
  std::vector<int> reversed = same, mirrored = same;
  bool reversible = rows.size() > 2, mirrors = false;
  for (std::size_t a = 0; a < rows.size(); ++a) {
    const Row& other = rows[rows.size() - 1 - a];
    reversible = reversible && rows[a].tags.size() == other.tags.size();
    if (reversible) exchange(rows[a], other, reversed);
    const std::size_t count = rows[a].tags.size();
    mirrors = mirrors || count > 2;
    for (std::size_t i = 0; i < count; ++i) {
      mirrored[static_cast<std::size_t>(rows[a].tags[i])] = rows[a].tags[count - 1 - i];
    }
  }
  if (reversible) {
    addPermutation("tag_rows_reversed", "all tags", reversed,
                   "the rows are counted from the tip: number them from the base in the scene",
                   trials);
  }
  if (mirrors) {
    addPermutation("tags_mirrored", "all tags", mirrored,
                   "the tags of each row are in the other order around the arm: turn it in the "
                   "scene",
                   trials);
  }
}

// Of a tag about its normal, counterclockwise as one reads it.
Eigen::Matrix3d quarterTurns(int quarters) {
  return Eigen::AngleAxisd(0.5 * basics::kPi * quarters, Eigen::Vector3d::UnitZ())
      .toRotationMatrix();
}

void addTurns(const TagLayout& layout, ReadingKind kind, const CalibrationOptions& options,
              std::vector<Trial>& trials) {
  // Positions alone do not show how a tag is turned.
  if (kind == ReadingKind::kPoses && options.rotation_noise == 0) return;
  std::vector<Row> rows = rowsOf(layout);
  Row all;
  for (const Row& row : rows) all.tags.insert(all.tags.end(), row.tags.begin(), row.tags.end());
  all.name = "all tags";
  if (rows.size() > 1) rows.push_back(all);
  for (const Row& row : rows) {
    for (int quarters = 1; quarters < 4; ++quarters) {
      const auto turned = [tags = row.tags](int tag) {
        return std::find(tags.begin(), tags.end(), tag) != tags.end();
      };
      const Eigen::Matrix3d turn = quarterTurns(quarters);
      trials.push_back(
          {"tags_turned",
           row.name,
           [turned, turn, quarters](double, Case& one) {
             changeObservations<Poses>(one, [&](PoseObservation& seen) {
               if (turned(seen.tag)) seen.X_BT.rotation *= turn.transpose();
             });
             changeObservations<CornersSeen>(one, [&](CornerObservation& seen) {
               if (!turned(seen.tag)) return;
               const Corners read = seen.direction;
               for (int i = 0; i < 4; ++i) seen.direction.col(i) = read.col((i + 4 - quarters) % 4);
             });
           },
           [quarters](double, const Calibration&) {
             return text("they are glued turned by ", 90 * quarters,
                         " degrees counterclockwise: turn them in the scene's tags, or on the arm");
           },
           {0.0},
           true,
           0,
           [tags = row.tags, turn](TagLayout& on_arm) {
             for (const int tag : tags) {
               on_arm.tags[static_cast<std::size_t>(tag)].X_ST.rotation *= turn;
             }
           }});
    }
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

void addPictureTrials(const Camera& camera, std::vector<Trial>& trials) {
  for (const int side : {320, 640, 800, 1024, 1280, 1600, 1920, 2560, 3840}) {
    if (side == camera.width) continue;
    const double factor = static_cast<double>(camera.width) / side;
    trials.push_back({"picture_size", "the camera",
                      [factor](double, Case& one) {
                        // Pixel (0, 0) is the centre of the first one.
                        const Eigen::Vector2d half(0.5, 0.5);
                        changePixels(one, [&](const Eigen::Vector2d& pixel) {
                          return Eigen::Vector2d(factor * (pixel + half) - half);
                        });
                        // The noise is of the picture as it is.
                        one.options.corner_noise *= factor;
                        one.options.corner_floor *= factor;
                      },
                      [side, width = camera.width](double, const Calibration&) {
                        return text("the pictures are ", side,
                                    " pixels wide, those that the camera was "
                                    "calibrated at ",
                                    width,
                                    ": take them at that size, or calibrate the camera at "
                                    "this one");
                      }});
  }
  trials.push_back(
      {"picture_turned", "the camera",
       [](double, Case& one) {
         const Camera& taken = one.arms.front().camera;
         const Eigen::Vector2d last(taken.width - 1, taken.height - 1);
         changePixels(one,
                      [&](const Eigen::Vector2d& pixel) { return Eigen::Vector2d(last - pixel); });
       },
       [](double, const Calibration&) {
         return std::string("the pictures are upside down: turn the camera, or its pictures");
       }});
  trials.push_back({"tag_size",
                    "all tags",
                    [](double factor, Case& one) { one.arms.front().layout.size *= factor; },
                    [](double, const Calibration& fit) {
                      return text(
                          "write tags.size_m: ", std::round(1e5 * fit.layout.size) / 1e5,
                          " into the scene, measured over the outer edge of the black border");
                    },
                    {0.6, 0.8, 1.25, 1.6},
                    false,
                    1,
                    kSamePlaces,
                    1.0,
                    kLeastTagError});
}

// ---- The rig ----

double usualOf(const Eigen::VectorXd& scales) {
  return basics::medianOf(std::vector<double>(scales.begin(), scales.end()));
}

// The muscle whose length differs most from the others'.
Eigen::Index oddMuscle(const Eigen::VectorXd& scales) {
  Eigen::Index odd = 0;
  (scales.array() - usualOf(scales)).abs().maxCoeff(&odd);
  return odd;
}

void addRigTrials(const ArmCaptures& arm, const CalibrationOptions& options, ReadingKind kind,
                  std::vector<Trial>& trials) {
  const bool corners = kind == ReadingKind::kCorners;
  const bool tags = corners || kind == ReadingKind::kPoses;
  if (tags && !options.base) {
    trials.push_back({corners ? "camera_moved" : "base_moved",
                      corners ? "the camera" : "the base",
                      [](double, Case& one) {
                        one.options.base = true;
                        one.options.base_prior = {kFarBase, kFarBaseTurn};
                      },
                      [](double, const Calibration& fit) {
                        return text(
                            "it is ", std::round(kMillimetres * fit.X_B0B.translation.norm()),
                            " mm and ",
                            std::round(fit.X_B0B.log().tail<3>().norm() * 1800 / basics::kPi) / 10,
                            " degrees from where the scene has it: fit base as well");
                      },
                      {0.0},
                      false,
                      kPlace,
                      kSamePlaces,
                      0.0,
                      -1.0,
                      [](const Calibration& fit) {
                        return fit.X_B0B.translation.norm() > kLeastMove ||
                               fit.X_B0B.log().tail<3>().norm() > kLeastTurn;
                      }});
  }
  if (options.free_shapes) return;
  const int count = arm.arm.actuatorCount();
  if (options.length_scale != LengthScaling::kEach && !options.contraction) {
    trials.push_back({"muscle_length",
                      "",
                      [](double, Case& one) {
                        one.options.length_scale = LengthScaling::kEach;
                        one.options.length_scale_prior = kScaleOfMuscle;
                      },
                      [arms = arm.arm](double, const Calibration& fit) {
                        std::string out = "the muscles are";
                        for (int i = 0; i < arms.actuatorCount(); ++i) {
                          out += text(i > 0 ? ", " : " ", arms.actuator(i).name, " ",
                                      std::round(1e3 * fit.length_scale[i]) / 10, " %");
                        }
                        return out + " of the length in the scene: fit length_scale_each as well";
                      },
                      {0.0},
                      false,
                      static_cast<double>(count),
                      kSamePlaces,
                      0.0,
                      -1.0,
                      [](const Calibration& fit) {
                        const Eigen::Index odd = oddMuscle(fit.length_scale);
                        return std::abs(fit.length_scale[odd] - usualOf(fit.length_scale)) >
                               kLeastLength;
                      }});
  }
  if (arm.isLoaded()) {
    for (const double factor : {-1.0, 0.0}) {
      trials.push_back({"load",
                        "gravity",
                        [factor](double, Case& one) { one.arms.front().load->gravity *= factor; },
                        [factor](double, const Calibration&) {
                          return std::string(factor < 0
                                                 ? "it points the other way: turn load.gravity "
                                                   "or the base in the scene"
                                                 : "the arm hangs from nothing: leave its "
                                                   "weight out of the scene's load");
                        },
                        {0.0},
                        false});
    }
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
  if (kind == ReadingKind::kPoses || kind == ReadingKind::kCorners) {
    addRowTrials(arm.layout, trials);
    addTurns(arm.layout, kind, options, trials);
  }
  if (kind == ReadingKind::kCorners) addPictureTrials(arm.camera, trials);
  addRigTrials(arm, options, kind, trials);
  return trials;
}

// The best size of a trial, and its misfit.
struct Found {
  double size = 0, misfit = 0, price = 1;
  const Trial* trial = nullptr;
};

std::optional<Found> best(const Trial& trial, const std::vector<ArmCaptures>& arms,
                          const Misfit& misfit) {
  std::map<double, Square> known;
  const auto at = [&](double size) {
    Case one{arms, misfit.options()};
    trial.correct(size, one);
    if (const auto found = misfit.of(one, trial.sizes.size() > 1)) known.emplace(size, *found);
  };
  const auto least = [&] {
    return std::min_element(known.begin(), known.end(), [](const auto& a, const auto& b) {
      return a.second.mean < b.second.mean;
    });
  };
  for (const double size : trial.sizes) at(size);
  if (known.empty()) return std::nullopt;
  // The bracket of the best one is halved from both sides.
  constexpr int kHalvings = 5;
  for (int round = 0; round < kHalvings && trial.sizes.size() > 1; ++round) {
    const auto here = least();
    std::vector<double> middles;
    if (here != known.begin()) middles.push_back(0.5 * (here->first + std::prev(here)->first));
    if (std::next(here) != known.end()) {
      middles.push_back(0.5 * (here->first + std::next(here)->first));
    }
    for (const double middle : middles) at(middle);
  }
  const auto& [size, square] = *least();
  return Found{size, square.mean, 1 + kPriceOfNumber * (trial.numbers + square.moved), &trial};
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

// The suspect of a trial; nothing if it explains too little, or is too small for a mistake.
std::optional<Suspect> named(const Found& one, const Evidence& evidence, const Misfit& misfit) {
  const Trial& trial = *one.trial;
  const Square& before = evidence.before;
  if (std::abs(one.size - trial.neutral) < trial.least) return std::nullopt;
  const double lowered = one.price * one.misfit / before.mean;
  const double gain = -0.5 * before.residuals * std::log(lowered);
  // Pressures outside the limits are wrong, however little that shows.
  const double most = !evidence.inside        ? kLoweredInside
                      : one.misfit < kAsNoise ? kLowered
                                              : kLoweredFar;
  if (lowered > most || (evidence.inside && gain < kLeastGain)) return std::nullopt;
  const double beyond = before.mean - std::min(1.0, one.misfit);
  const double explains = beyond > 0 ? (before.mean - one.misfit) / beyond : 0;
  if (explains < kLeastShare) return std::nullopt;
  Case corrected{evidence.read, misfit.options()};
  trial.correct(one.size, corrected);
  clampPressures(corrected.arms);
  const Calibration fit = calibrate(corrected.arms, corrected.options);
  if (fit.shapes.empty()) return std::nullopt;  // refused
  if (trial.shows && !trial.shows(fit)) return std::nullopt;
  std::string where = trial.where;
  if (where.empty()) {
    where = evidence.read.front().arm.actuator(static_cast<int>(oddMuscle(fit.length_scale))).name;
  }
  Suspect suspect{trial.cause, where, explains, trial.remedy(one.size, fit), {}, {}};
  TagLayout layout = corrected.arms.front().layout;
  trial.place(layout);
  if (trial.cause.rfind("tag", 0) == 0) suspect.layout = std::move(layout);
  if (trial.corrects_captures) suspect.corrected = std::move(corrected.arms);
  return suspect;
}

// The suspects of all trials, the best first.
std::vector<Suspect> namedOf(const std::vector<Found>& found, const Evidence& evidence,
                             const Misfit& misfit) {
  std::vector<Suspect> out;
  double least = evidence.inside ? evidence.before.mean : 0.0;
  for (const Found& one : found) {
    if (misfit.stopped()) return {};
    if (out.size() == kMostNamed) break;
    if (std::optional<Suspect> suspect = named(one, evidence, misfit)) {
      least = std::min(least, one.misfit);
      out.push_back(*suspect);
    }
  }
  // No single mistake brings the readings near to this arm.
  if (least > kFar * kFar * evidence.before.usual) {
    Suspect other{"other_arm",
                  "all captures",
                  0.0,
                  "no single mistake explains them: check that captures and scene are of the same "
                  "arm, and look for several mistakes",
                  {},
                  {}};
    out.insert(out.begin(), std::move(other));
  }
  return out;
}

}  // namespace

std::vector<Suspect> suspectsOf(const std::vector<ArmCaptures>& arms,
                                const CalibrationOptions& options,
                                const std::function<bool()>& stop) {
  options.validate();
  const std::vector<ArmCaptures> read = withReadings(arms);
  if (read.empty() || read.front().captures.empty()) return {};
  const std::optional<bool> outside = isOutside(read);
  if (!outside) return {};
  Misfit misfit(options, stop);
  Case given{read, misfit.options()};
  const std::optional<Square> fitted = misfit.of(given, true, true);
  // What cannot be fitted for another reason than its pressures has no suspects.
  if (!fitted && !*outside && groupByPressure(read).pressure.size() > 1) return {};
  Evidence evidence{read, fitted.value_or(Square{kNoFit, static_cast<int>(kNoFit)}),
                    fitted && !*outside};
  // A wrong tag size is taken up by the bleeding, as far as it is fitted.
  if (std::abs(evidence.before.bleed) > kMostBleed * options.bleed_prior) {
    given.options.bleed = false;
    misfit = Misfit(given.options, stop);
    evidence.before = misfit.of(given, true).value_or(evidence.before);
  }
  if (evidence.inside && evidence.before.mean < kAsNoise) return {};
  const std::vector<Trial> trials = trialsFor(read.front(), options, kindOf(firstReading(read)));
  std::vector<Found> found;
  for (const Trial& trial : trials) {
    if (std::optional<Found> one = best(trial, read, misfit)) found.push_back(*one);
  }
  std::stable_sort(found.begin(), found.end(), [](const Found& a, const Found& b) {
    return a.price * a.misfit < b.price * b.misfit;
  });
  return namedOf(found, evidence, misfit);
}

}  // namespace helix_arm::estimation
