# One vehicle's nodes on ROS 2 Jazzy, for amd64 and arm64; a BlueOS extension. docs/guide/bench-to-water.md says how to
# use it. Simulator and shore tools stay outside.
FROM ros:jazzy-ros-base AS build
SHELL ["/bin/bash", "-c"]
WORKDIR /build
COPY auv_lse_msgs src/auv_lse_msgs
COPY auv_lse_common src/auv_lse_common
COPY auv_lse_run src/auv_lse_run
COPY auv_lse_gp src/auv_lse_gp
COPY auv_lse_planner src/auv_lse_planner
COPY auv_lse_comms src/auv_lse_comms
COPY auv_lse_mavlink src/auv_lse_mavlink
COPY auv_lse_record src/auv_lse_record
RUN source /opt/ros/jazzy/setup.bash && \
    colcon build --base-paths src --merge-install --install-base /opt/auv_lse/install --cmake-args -DBUILD_TESTING=OFF

FROM ros:jazzy-ros-core
# What the package.xml files name, and no more. NumPy stays Ubuntu's, with which its SciPy was built.
RUN apt-get update && apt-get install -y --no-install-recommends \
        python3-matplotlib \
        python3-numpy \
        python3-pip \
        python3-pyproj \
        python3-rich \
        python3-scipy \
        python3-serial \
        python3-yaml \
        ros-jazzy-ament-index-python \
        ros-jazzy-builtin-interfaces \
        ros-jazzy-diagnostic-msgs \
        ros-jazzy-geometry-msgs \
        ros-jazzy-launch \
        ros-jazzy-launch-ros \
        ros-jazzy-nav-msgs \
        ros-jazzy-rcl-interfaces \
        ros-jazzy-rclpy \
        ros-jazzy-rosgraph-msgs \
        ros-jazzy-rosidl-default-runtime \
        ros-jazzy-sensor-msgs \
        ros-jazzy-std-msgs \
        ros-jazzy-visualization-msgs \
    && rm -rf /var/lib/apt/lists/*
COPY config/constraints.txt /opt/auv_lse/config/
RUN sed '/^numpy==/d' /opt/auv_lse/config/constraints.txt > /tmp/constraints.txt && \
    python3 -m pip install --no-cache-dir --break-system-packages --constraint /tmp/constraints.txt \
        mcap pymavlink rosbags
COPY --from=build /opt/auv_lse/install /opt/auv_lse/install
# Ubuntu's first user, 1000, opens serial ports and writes dives into the volume.
RUN usermod --append --groups dialout ubuntu && \
    install --directory --owner=ubuntu /data && \
    ln -s /data/dives /opt/auv_lse/dives
USER ubuntu
# Second copies of the vehicle's state outlive the container; safety.state_copies may name a volume on another disk.
ENV AUV_LSE_ROOT=/opt/auv_lse OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 STATE_DIRECTORY=/data/state
WORKDIR /data
VOLUME /data
STOPSIGNAL SIGTERM
# Which vehicle this is (auv2), if the file has several, and its mission file.
ENV AUV_LSE_VEHICLE= AUV_LSE_MISSION=/data/vehicle.yaml
ENTRYPOINT ["/bin/bash", "-c", "source /opt/ros/jazzy/setup.bash && source /opt/auv_lse/install/local_setup.bash && { mkdir -p /data/dives || true; } && exec auv_lse vehicle --wait \"$@\"", "vehicle"]

# BlueOS reads these. It runs the container on the host's network, where the autopilot's endpoint is.
LABEL version="0.2.0"
LABEL permissions='{\
  "Env": ["AUV_LSE_VEHICLE=", "AUV_LSE_MISSION=/data/vehicle.yaml"],\
  "HostConfig": {\
    "NetworkMode": "host",\
    "Binds": ["/usr/blueos/userdata/auv_lse:/data", "/dev:/dev"],\
    "DeviceCgroupRules": ["c 166:* rmw", "c 188:* rmw"]\
  }\
}'
LABEL authors='[{"name": "AUV LSE developers", "email": "maintainers@auv-lse.org"}]'
LABEL company='{"about": "", "name": "AUV LSE developers", "email": "maintainers@auv-lse.org"}'
LABEL type="other"
LABEL tags='["mapping", "navigation"]'
# Where BlueOS shows the README from; who publishes the image says it: --build-arg README_URL=...
ARG README_URL
LABEL readme="$README_URL"
LABEL links='{"website": "https://arxiv.org/abs/2412.19409"}'
LABEL requirements="core >= 1.1"
