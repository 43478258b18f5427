#include "ros_bridge/calibration/calibration_node.hpp"

#include <utility>

#include "ros_bridge/common/file_access.hpp"
#include "ros_bridge/common/log.hpp"
#include "ros_bridge/common/parameters.hpp"
#include "ros_bridge/common/pneumatics.hpp"

namespace helix_arm::ros_bridge {

CalibrationNodeOptions CalibrationNodeOptions::load() {
  ParameterReader reader{ros::NodeHandle("~")};
  CalibrationNodeOptions out;
  procedures::SettleRules& settle = out.settle;
  out.scene = reader.file("scene", "config/scenes", ".yaml");
  settle.pressure_tolerance =
      1e3 * reader.number("pressure_tolerance_kpa", 1e-3 * settle.pressure_tolerance, {0.01, 100});
  settle.corner_tolerance =
      reader.number("corner_tolerance_px", settle.corner_tolerance, {0.01, 100});
  settle.window = reader.number("window_s", settle.window, {0.05, 60});
  settle.max_age = reader.number("max_age_s", settle.max_age, {0.05, 60});
  out.run.ramp = 1e3 * reader.number("ramp_kpa_s", 1e-3 * out.run.ramp, {0.1, 10000});
  out.run.patience = reader.number("patience_s", out.run.patience, {0.1, 3600});
  out.rate = reader.number("rate", out.rate, {5, 1000});
  out.scene_folder = reader.folder("scene_folder", defaultFolder());
  out.data_folder = reader.folder("data_folder", defaultFolder());
  out.out_folder = reader.folder("out_folder", defaultFolder());
  reader.finish();
  return out;
}

CalibrationNode::CalibrationNode()
    : options_(CalibrationNodeOptions::load()),
      recorder_(node_, requirePneumatic(io::loadScene(options_.scene)), options_.settle),
      calibrator_(options_.data_folder, options_.out_folder, options_.settle,
                  [this] { return reload_.file(); }),
      services_(private_node_, jobs_, recorder_, calibrator_),
      reload_(private_node_, options_.scene, options_.scene_folder,
              [this](io::Scene next) { adopt(std::move(next)); }),
      run_(node_, private_node_, options_.run, options_.rate, jobs_, recorder_, calibrator_) {
  const io::Scene scene = recorder_.scene();
  logInfo("%s: %s", scene.name.c_str(),
          scene.camera && scene.tags
              ? "ready to record and to calibrate"
              : "ready to calibrate from data sets; its scene lacks `camera` or `tags`, so "
                "nothing can be recorded");
}

CalibrationNode::~CalibrationNode() = default;

void CalibrationNode::adopt(io::Scene next) {
  jobs_.whileIdle([&] {
    recorder_.adopt(std::move(next));
    calibrator_.forgetLast();
  });
}

}  // namespace helix_arm::ros_bridge
