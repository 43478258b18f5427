# helix_arm in a container. Release: docker build --build-arg RELEASE=trixie (Debian 12 without it).
#   docker build -t helix_arm . && docker run --rm helix_arm                       the simulated rig, headless
#   docker run --rm -it helix_arm bash                                             the command, and all of ROS
#   xhost +local: && docker run --rm -e DISPLAY -v /tmp/.X11-unix:/tmp/.X11-unix helix_arm roslaunch helix_arm demo.launch
# Where docker does not run, .ci/chroot builds the same stages.
# A regulator: --device /dev/serial/by-id/NAME, and only one container per device, since locks do not cross containers.
ARG RELEASE=bookworm

# What the package is built and tested with; .devcontainer uses it alone.
FROM debian:${RELEASE} AS tools
COPY scripts /helix_arm/scripts
RUN /helix_arm/scripts/install tests

FROM tools AS build
COPY . /helix_arm
RUN /helix_arm/scripts/package

FROM debian:${RELEASE} AS run
COPY --from=build /helix_arm/build/package/*.deb /packages/
COPY scripts /helix_arm/scripts
RUN /helix_arm/scripts/install /packages
ENV ROS_HOSTNAME=localhost
CMD ["roslaunch", "helix_arm", "demo.launch", "rviz:=false"]
