#pragma once

#include <QWidget>

#include "helix_arm/ros_bridge/cockpit/cockpit_view.hpp"
#include "helix_arm/ros_bridge/cockpit/strip_history.hpp"

namespace helix_arm::rviz_panel {

/// Pressures (upper half, kPa) and tip error (lower half, mm) over the last seconds.
class StripChart : public QWidget {
 public:
  explicit StripChart(QWidget* parent);

  /// Adds a moment. @param now  steady time [s].
  void add(double now, const ros_bridge::CockpitView& view);
  void clear();

  const ros_bridge::StripHistory& history() const { return history_; }

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  void drawPressures(QPainter& painter, const QRectF& area) const;
  void drawError(QPainter& painter, const QRectF& area) const;

  ros_bridge::StripHistory history_;
  bool from_target_ = false;  ///< the error is that of the closed loop, not that of the model
};

}  // namespace helix_arm::rviz_panel
