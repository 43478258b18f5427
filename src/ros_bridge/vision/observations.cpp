#include "observations.hpp"

#include <opencv2/imgproc.hpp>

#include "basics/text.hpp"
#include "helix_arm/model/curve.hpp"
#include "helix_arm/tracking/error_budget.hpp"
#include "procedures/loop_config.hpp"
#include "ros_bridge/common/conversions.hpp"
#include "ros_bridge/names.hpp"

namespace helix_arm::ros_bridge {
namespace {

using diagnostic_msgs::DiagnosticStatus;

// `3, 4, 7`; the first few of many.
template <class Ids>
std::string listOf(const Ids& ids) {
  constexpr std::size_t kMost = 8;
  std::string out;
  for (std::size_t k = 0; k < std::min(ids.size(), kMost); ++k) {
    out += (k > 0 ? ", " : "") + std::to_string(ids[k]);
  }
  return ids.size() > kMost ? out + ", ..." : out;
}

bool has(const std::vector<int>& ids, int id) {
  return std::find(ids.begin(), ids.end(), id) != ids.end();
}

std::string countText(int count, bool of_bodies) {
  if (of_bodies) return std::to_string(count) + (count == 1 ? " body" : " bodies");
  return std::to_string(count) + (count == 1 ? " tag" : " tags");
}

// Names the bodies that are not seen, and tells their mistakes, if there are any.
std::string unseenBodies(const vision::Observation& observation,
                         const estimation::TagLayout& layout) {
  std::vector<std::string> unseen;
  for (const estimation::TagPlacement& body : layout.tags) {
    const bool seen = std::any_of(observation.poses.begin(), observation.poses.end(),
                                  [&body](const auto& one) { return one.body == body.id; });
    if (!seen) unseen.push_back(body.name);
  }
  std::string out = unseen.empty() ? "" : "; not seen: " + basics::joined(unseen);
  if (!observation.fault.empty()) out += "; " + observation.fault;
  return out;
}

// Lists the ids that no fit can use, if there are any.
std::string unknownTags(const vision::Observation& observation) {
  std::string out;
  if (!observation.unknown_ids.empty())
    out += "; not of the scene: " + listOf(observation.unknown_ids);
  if (!observation.repeated_ids.empty()) out += "; seen twice: " + listOf(observation.repeated_ids);
  if (!observation.unusable_ids.empty()) {
    out += "; where the lens distortion cannot be inverted: " + listOf(observation.unusable_ids);
  }
  return out;
}

// Residual of the tag with this id; null if it was not used in the fit.
const estimation::TagResidual* residualOf(const vision::Observation& observation,
                                          const estimation::TagLayout& layout, int id) {
  if (observation.state != vision::ObservationState::kMeasured) return nullptr;
  const auto& tags = observation.fit.tags;
  const auto found = std::find_if(tags.begin(), tags.end(), [&](const auto& residual) {
    return layout.tags[residual.tag].id == id;
  });
  return found == tags.end() ? nullptr : &*found;
}

// Number of visible tags of the arm that were seen once.
int tagsOfArm(const vision::Observation& observation) {
  const auto& tags = observation.detections;
  return static_cast<int>(std::count_if(tags.begin(), tags.end(), [&](const auto& tag) {
    return !has(observation.unknown_ids, tag.id) && !has(observation.repeated_ids, tag.id);
  }));
}

BodyPoses toMsg(const std_msgs::Header& header, const std::vector<estimation::BodyPose>& poses,
                const estimation::TagLayout& layout) {
  BodyPoses msg;
  msg.header = header;
  for (const estimation::BodyPose& one : poses) {
    msg.name.push_back(layout.tags[static_cast<std::size_t>(one.body)].name);
    msg.pose.push_back(toPoseMsg(one.X_CM));
  }
  return msg;
}

TagDetections toMsg(const std_msgs::Header& header, const vision::Observation& observation,
                    const estimation::TagLayout& layout) {
  TagDetections msg;
  msg.header = header;
  msg.tags.reserve(observation.detections.size());
  for (const vision::TagDetection& detection : observation.detections) {
    TagDetection tag;
    tag.id = detection.id;
    std::copy(detection.corners.data(), detection.corners.data() + 8, tag.corners.begin());
    tag.hamming = static_cast<std::uint8_t>(detection.hamming);
    tag.margin = detection.margin;
    tag.known = layout.find(detection.id) >= 0;
    tag.repeated = has(observation.repeated_ids, detection.id);
    const auto* residual = residualOf(observation, layout, detection.id);
    tag.fitted = residual != nullptr && !tag.repeated;
    if (tag.fitted) {
      tag.residual = residual->rms;
      tag.weight = residual->weight;
      tag.outlier = residual->outlier;
    }
    msg.tags.push_back(tag);
  }
  return msg;
}

ModelError toMsg(const std_msgs::Header& header, const estimation::TwistFit& fit,
                 const ModelHistory::Entry& model) {
  ModelError msg;
  msg.header = header;
  msg.model_stamp = model.stamp;
  msg.sections = static_cast<std::uint32_t>(fit.twists.cols());
  const model::Twists expected = model.shape.twists(), difference = fit.twists - expected;
  msg.twist.assign(difference.data(), difference.data() + difference.size());
  const Eigen::Vector3d error =
      model::tipPose(fit.shape).translation - model::tipPose(model.shape).translation;
  msg.tip = toVectorMsg(error);
  msg.tip_error = error.norm();
  // The speed along a piece of constant twist is |v|.
  msg.tip_error_percent =
      100.0 * msg.tip_error / model.shape.pieces().topRows<3>().colwise().norm().sum();
  // The covariance is in the frame of the nominal base.
  const Eigen::Vector3d direction = fit.X_B0B.rotation * error.stableNormalized();
  msg.tip_sigma = std::sqrt(std::max(0.0, direction.dot(fit.tip_covariance * direction)));
  msg.tag_rms = fit.rms;
  return msg;
}

// Standard deviation of the measured tip along its worst direction [m].
double tipDeviation(const estimation::TwistFit& fit) {
  return estimation::TipSpread{fit.tip_covariance}.deviation();
}

// `8 tags, 0.20 px, tip noise 0.5 mm`: summary of a measured shape. How well the tags are placed is
// not part of the noise: the error budget adds it.
std::string summarise(const vision::Observation& observation, int tags) {
  const int outliers = observation.fit.outliers();
  const bool of_bodies = !observation.poses.empty();
  return countText(tags, of_bodies) +
         (outliers > 0 ? " (" + std::to_string(outliers) + " off)" : "") + ", " +
         (of_bodies ? fixed(1e3 * observation.fit.rms, 2) + " mm"
                    : fixed(observation.fit.rms, 2) + " px") +
         ", tip noise " + fixed(1e3 * tipDeviation(observation.fit), of_bodies ? 2 : 1) + " mm";
}

std::string describe(const vision::Observation& observation, int tags,
                     const estimation::TagLayout& layout, const vision::LocalizerConfig& config) {
  using vision::ObservationState;
  const bool of_bodies = layout.hasBodies();
  const std::string count = countText(tags, of_bodies);
  std::string out = "no shape of the arm fits the " + count;
  if (observation.state == ObservationState::kMeasured) {
    out = summarise(observation, tags);
  } else if (observation.state == ObservationState::kNoTags) {
    out = of_bodies ? "no body of the arm is seen: check markers and the system's view"
                    : "no tag of the arm is in sight: check the view, the light, and the scene's "
                      "tags.family";
  } else if (observation.state == ObservationState::kTooFewTags) {
    out = of_bodies ? count +
                          " do not determine the shape: check markers and the system's view, or "
                          "place more bodies"
                    : count + " in sight do not determine the shape; at least " +
                          std::to_string(config.min_tags) +
                          " are needed, on all sections: check occlusion and light";
  } else if (!of_bodies) {
    out += " in sight: check their size and poses in the scene, and the camera's calibration";
  } else if (observation.fault.empty()) {
    out += ": check their places in the scene, motion_capture.frame, and their names";
  }
  return out + (of_bodies ? unseenBodies(observation, layout) : unknownTags(observation));
}

std::string uncalibratedTags(const estimation::TwistFit& fit, const estimation::TagLayout& layout) {
  std::vector<int> fitted;
  for (const estimation::TagResidual& tag : fit.tags) fitted.push_back(tag.tag);
  const std::string text =
      procedures::uncalibratedText(procedures::uncalibratedTags(layout, fitted));
  return text.empty() ? text : "; " + text;
}

std::string tipText(const estimation::TwistFit& fit, const ModelError* error) {
  if (error == nullptr) return "tip noise " + fixed(1e3 * tipDeviation(fit)) + " mm";
  return "model off by " + fixed(1e3 * error->tip_error) + " mm (" +
         fixed(error->tip_error_percent) + " %)";
}

constexpr int kOverlayPoints = 48;  // of a curve, per section; even: dashes are drawn in pairs
constexpr int kTextRows = 4;        // below the picture, at least: its size stays as it is

constexpr int kShift = 4;  // OpenCV's fixed point: sixteenths of a pixel

const cv::Scalar kFits(255, 200, 120), kDoesNotFit(50, 60, 255), kNotUsed(170, 170, 170);

// Colours of kLegend (arm_markers.cpp).
const cv::Scalar kMeasured(26, 140, 255), kModel(69, 179, 46), kDark(30, 30, 30);

// Sizes of lines and letters that stay legible if the picture is shown much smaller.
struct Pen {
  cv::Mat& picture;
  int width;
  double letter;

  explicit Pen(cv::Mat& on)
      : picture(on), width(std::max(1, on.cols / 400)), letter(std::max(0.4, on.cols / 640.0)) {}

  static cv::Point fine(const Eigen::Vector2d& p) {
    constexpr double kFar = 1e5;  // [px]; fixed point overflows beyond
    const double unit = 1 << kShift;
    return {static_cast<int>(std::lround(unit * std::clamp(p.x(), -kFar, kFar))),
            static_cast<int>(std::lround(unit * std::clamp(p.y(), -kFar, kFar)))};
  }
  void line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const cv::Scalar& color) const {
    cv::line(picture, fine(a), fine(b), color, width, cv::LINE_AA, kShift);
  }
  void text(const std::string& words, cv::Point place, double size, const cv::Scalar& color) const {
    const auto put = [&](const cv::Scalar& ink, int thickness) {
      cv::putText(picture, words, place, cv::FONT_HERSHEY_SIMPLEX, size, ink, thickness,
                  cv::LINE_AA);
    };
    put(kDark, 2 * width + 4);
    put(color, width + 1);
  }

  // Whether a line is no wider than this [px].
  bool fits(const std::string& line, double widest) const {
    return cv::getTextSize(line, cv::FONT_HERSHEY_SIMPLEX, letter, width + 1, nullptr).width <=
           widest;
  }
};

cv::Mat withTextBelow(const cv::Mat& picture, const std::vector<std::string>& texts) {
  cv::Mat out = picture;
  const int height = static_cast<int>(std::lround(32 * Pen(out).letter)), indent = height / 3;
  std::vector<std::string> lines;
  for (const std::string& text : texts) {
    const auto fits = [&](const std::string& line) {
      return Pen(out).fits(line, picture.cols - 2 * indent);
    };
    for (std::string& line : wrapped(text, fits)) lines.push_back(std::move(line));
  }
  const int rows = std::max(kTextRows, static_cast<int>(lines.size()));
  cv::copyMakeBorder(picture, out, 0, rows * height + indent, 0, 0, cv::BORDER_CONSTANT, kDark);
  int row = picture.rows;
  for (const std::string& line : lines) {
    Pen(out).text(line, {indent, row += height}, Pen(out).letter, kMeasured);
  }
  return out;
}

void drawCurve(const Pen& pen, const estimation::Camera& camera, const lie::SE3& X_CB,
               const model::Shape& shape, const cv::Scalar& color, bool dashed) {
  std::optional<Eigen::Vector2d> last;
  int k = 0;
  for (const auto& point : model::sampleToTip(shape, shape.sectionCount() * kOverlayPoints)) {
    const auto pixel = camera.project(X_CB * point.X.translation);
    if (pixel && last && (!dashed || k % 2 == 1)) pen.line(*last, *pixel, color);
    last = pixel;
    ++k;
  }
}

cv::Scalar colorOf(const TagDetection& tag) {
  if (!tag.fitted) return kNotUsed;
  return tag.outlier ? kDoesNotFit : kFits;
}

// States of VisionStatus, by vision::ObservationState.
constexpr std::uint8_t kStates[] = {VisionStatus::MEASURED, VisionStatus::NO_TAGS,
                                    VisionStatus::FEW_TAGS, VisionStatus::NO_FIT};

// Name of a state of VisionStatus.
const char* nameOfState(std::uint8_t state) {
  static constexpr std::array<const char*, VisionStatus::ENDED + 1> kNames = {
      "measured", "few_tags", "no_tags", "no_fit", "waiting", "stale", "camera_fault", "ended"};
  return state < kNames.size() ? kNames[state] : "in an unknown state";
}

// By PictureFault.
constexpr std::uint64_t VisionStatus::*kCounters[kPictureFaultCount] = {
    &VisionStatus::bad_jpeg,        &VisionStatus::wrong_encoding, &VisionStatus::wrong_size,
    &VisionStatus::bad_camera_info, &VisionStatus::bad_model,      &VisionStatus::source_faults,
    &VisionStatus::bad_poses};

std::string rateText(std::uint64_t count, double seconds) {
  return fixed(static_cast<double>(count) / seconds);
}

}  // namespace

ObservationReport reportOf(const Measurement& measurement, const std::string& base_frame,
                           const std::string& camera_frame) {
  const vision::Observation& observation = measurement.observation;
  const std_msgs::Header header = toHeaderMsg(measurement.stamp, base_frame);

  ObservationReport out;
  out.tags = tagsOfArm(observation);
  out.account = describe(observation, out.tags, measurement.view.layout, measurement.config);
  out.detections =
      toMsg(toHeaderMsg(measurement.stamp, camera_frame), observation, measurement.view.layout);
  if (!observation.poses.empty()) {
    out.bodies = toMsg(out.detections.header, observation.poses, measurement.view.layout);
  }
  if (!measurement.measured()) {
    out.lines = {out.account};
    return out;
  }
  out.shape = toShapeMsg(header, "measured", observation.fit.shape, observation.fit.covariance);
  if (measurement.model) out.error = toMsg(header, observation.fit, *measurement.model);
  out.tip = tipText(observation.fit, out.error ? &*out.error : nullptr);
  out.lines = {out.tip, summarise(observation, out.tags)};
  out.account += uncalibratedTags(observation.fit, measurement.view.layout);
  if (observation.moved) out.lines.push_back(observation.moved->message());
  return out;
}

cv::Mat drawOverlay(const Measurement& measurement, const ObservationReport& report) {
  const vision::Observation& observation = measurement.observation;
  const estimation::ArmView& view = measurement.view;
  const model::Shape* model = measurement.modelShape();
  cv::Mat picture;
  cv::cvtColor(measurement.gray, picture, cv::COLOR_GRAY2BGR);
  const Pen pen(picture);
  if (model != nullptr) drawCurve(pen, view.camera, view.X_CB, *model, kModel, true);
  if (measurement.measured()) {
    drawCurve(pen, view.camera, view.X_CB * observation.fit.X_B0B, observation.fit.shape, kMeasured,
              false);
  }
  for (std::size_t i = 0; i < observation.detections.size(); ++i) {
    const vision::TagDetection& tag = observation.detections[i];
    const cv::Scalar color = colorOf(report.detections.tags[i]);
    for (int k = 0; k < 4; ++k) pen.line(tag.corners.col(k), tag.corners.col((k + 1) % 4), color);
    const Eigen::Vector2d right = tag.corners.rowwise().maxCoeff();
    pen.text(std::to_string(tag.id),
             {static_cast<int>(right.x()) + 3 * pen.width, static_cast<int>(right.y())},
             0.5 * pen.letter, color);
  }
  return withTextBelow(picture, report.lines);
}

VisionStatusPublisher::VisionStatusPublisher(ros::NodeHandle& node, const std::string& name,
                                             const std::string& base_frame,
                                             const std::string& source, double stale_after,
                                             double draw_period, bool of_bodies)
    : node_name_(name),
      stale_after_(stale_after),
      of_bodies_(of_bodies),
      markers_(base_frame, draw_period),
      last_arrival_(ros::SteadyTime::now()),
      last_report_(last_arrival_),
      status_publisher_(node.advertise<VisionStatus>(names::kVisionStatus, 10)),
      marker_publisher_(
          node.advertise<visualization_msgs::MarkerArray>(names::kMeasuredMarkers, 2)),
      diagnostics_(node) {
  status_.state = VisionStatus::WAITING;
  status_.message = std::string("no ") + input_ + " was received yet from " + source;
}

void VisionStatusPublisher::countLocked(const PictureRefusal& refusal) {
  FaultCount& count = faults_[static_cast<std::size_t>(refusal.fault)];
  const bool tell = count.add();
  ++refused_since_;
  status_.*kCounters[static_cast<std::size_t>(refusal.fault)] = count.total();
  status_.last_fault = refusal.message;
  if (!tell) return;
  logWarning("%s (%s, %lu so far)", refusal.message.c_str(), nameOf(refusal.fault), count.total());
}

void VisionStatusPublisher::saw(const Measurement& measurement, const ObservationReport& report) {
  const basics::MutexLock lock(mutex_);
  const vision::Observation& observation = measurement.observation;
  status_.unknown_ids.assign(observation.unknown_ids.begin(), observation.unknown_ids.end());
  status_.repeated_ids.assign(observation.repeated_ids.begin(), observation.repeated_ids.end());
  status_.unknown_tags += observation.unknown_ids.size();
  status_.repeated_tags += observation.repeated_ids.size();
  status_.tags = static_cast<std::uint32_t>(report.tags);
  if (measurement.measured()) ++status_.measured;
  const std::string moved = observation.moved ? observation.moved->message() : std::string();
  if (status_.base_moved.empty() && !moved.empty()) logWarning("%s", moved.c_str());
  status_.base_moved = moved;
  calibration_ = measurement.calibration;
  enterLocked(kStates[static_cast<int>(observation.state)],
              of_bodies_ ? report.account : report.account + "; calibration: " + calibration_);
}

void VisionStatusPublisher::enterLocked(std::uint8_t state, const std::string& message) {
  if (closed_) return;
  const bool was_measured = measured();
  const bool changed = state != status_.state;
  status_.state = state;
  status_.message = message;
  if (std::find(std::begin(kStates), std::end(kStates), state) == std::end(kStates)) {
    status_.tags = 0;
    status_.unknown_ids.clear();
    status_.repeated_ids.clear();
  }
  if (!changed) return;
  const bool told = state == VisionStatus::CAMERA_FAULT;  // by countLocked()
  if (!told && states_.at(state).add()) {
    const bool fine = state == VisionStatus::MEASURED || state == VisionStatus::ENDED;
    logLine(fine ? ros::console::levels::Info : ros::console::levels::Warn, "%s: %s",
            nameOfState(state), message.c_str());
  }
  publishStatusLocked();
  if (was_measured) marker_publisher_.publish(markers_.remove(ros::Time::now()));
}

DiagnosticStatus VisionStatusPublisher::cameraStatus(double seconds) {
  unsigned long total = 0;
  for (const FaultCount& count : faults_) total += count.total();
  const bool news = total > std::exchange(reported_faults_, total);
  const bool down =
      status_.state == VisionStatus::STALE || status_.state == VisionStatus::CAMERA_FAULT;
  const bool waits = status_.state == VisionStatus::WAITING;
  DiagnosticStatus out =
      makeStatus("camera",
                 down            ? DiagnosticStatus::ERROR
                 : news || waits ? DiagnosticStatus::WARN
                                 : DiagnosticStatus::OK,
                 down || waits ? status_.message
                 : news        ? status_.last_fault
                               : std::string(input_) + "s are received",
                 {{"pictures_hz", rateText(status_.pictures - reported_.pictures, seconds)},
                  {"pictures", std::to_string(status_.pictures)},
                  {"skipped", std::to_string(status_.skipped)}});
  for (int i = 0; i < kPictureFaultCount; ++i) {
    addValue(out, nameOf(PictureFault(i)), std::to_string(faults_[i].total()));
  }
  addValue(out, "calibration", calibration_);
  addValue(out, names::kLastFaultKey, status_.last_fault);
  return out;
}

DiagnosticStatus VisionStatusPublisher::measurementStatus(double seconds) const {
  return makeStatus("measurement",
                    !status_.base_moved.empty() ? DiagnosticStatus::ERROR
                    : measured()                ? DiagnosticStatus::OK
                                                : DiagnosticStatus::WARN,
                    status_.base_moved.empty() ? status_.message : status_.base_moved,
                    {{"state", nameOfState(status_.state)},
                     {"measured_hz", rateText(status_.measured - reported_.measured, seconds)},
                     {"tags", std::to_string(status_.tags)},
                     {"unknown_ids", listOf(status_.unknown_ids)},
                     {"repeated_ids", listOf(status_.repeated_ids)},
                     {"model_lag_s", model_lag_ ? fixed(*model_lag_, 3) : ""}});
}

}  // namespace helix_arm::ros_bridge
