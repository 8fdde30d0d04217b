"""Every backend beside the `Protocol` of its rule, and every `policy.py` beside `Runner`, for mypy.

`test_contract.py` checks that none is left out. Nothing imports this file: rules are found, not imported.
"""

import rules.align.canonical.canonical.canonical_geometry
import rules.align.canonical.canonical.canonical_qwen3_vl
import rules.align.canonical.canonical.canonical_stub
import rules.align.follow.follow.follow_deaot
import rules.align.follow.follow.follow_flow
import rules.align.follow.follow.follow_sam3_video
import rules.align.follow.follow.follow_stub
import rules.align.matches.matches.matches_disk_lightglue
import rules.align.matches.matches.matches_sift
import rules.align.matches.matches.matches_stub
import rules.align.matches.matches.matches_superpoint_lightglue
import rules.align.matches.matches.matches_xfeat
import rules.align.object.object.object_bounding_box
import rules.align.object.object.object_icp
import rules.align.object.object.object_open3d
import rules.align.object.object.object_stub
import rules.simulate.scene.scene.settle
import rules.simulate.scene.scene.settle_mujoco
import rules.simulate.scene.scene.settle_stub
import rules.simulate.scene.scene.steady
import rules.simulate.scene.scene.steady_mujoco
import rules.simulate.scene.scene.steady_stub
import rules.simulate.scene.scene.usd_openusd
import rules.simulate.scene.scene.usd_stub
import rules.simulate.task.task.perturbed
import rules.simulate.task.task.perturbed_mujoco
import rules.simulate.task.task.perturbed_stub
import rules.simulate.task.task.task_mujoco
import rules.simulate.task.task.task_stub

import dextera_build.policy.running
import rules.align.calibration.camera_motion
import rules.align.calibration.camera_motion_opencv
import rules.align.calibration.camera_motion_stub
import rules.align.calibration.hand_eye
import rules.align.calibration.hand_eye_opencv
import rules.align.calibration.hand_eye_stub
import rules.align.calibration.robot_camera
import rules.align.calibration.robot_camera_icp
import rules.align.calibration.robot_camera_stub
import rules.align.canonical.canonical
import rules.align.follow.follow
import rules.align.matches.matches
import rules.align.object.object
import rules.align.scene.scene
import rules.align.scene.scene_sift
import rules.align.scene.scene_stub
import rules.align.scene.scene_superpoint_lightglue
import rules.align.track.track
import rules.align.track.track_foundation_pose
import rules.align.track.track_model
import rules.align.track.track_stub
import rules.background.robot
import rules.background.robot_mujoco
import rules.background.robot_stub
import rules.background.room.compose
import rules.background.room.compose_gsplat
import rules.background.room.compose_points
import rules.background.room.compose_warp
import rules.background.room.compose_worldmirror
import rules.background.room.expand
import rules.background.room.expand_stub
import rules.background.room.expand_warp
import rules.background.room.panorama
import rules.background.room.panorama_frustum
import rules.background.room.panorama_hy_pano
import rules.background.room.panorama_stub
import rules.background.room.paths
import rules.background.room.paths_orbit
import rules.background.static
import rules.background.static_flux2
import rules.background.static_planes
import rules.background.static_stub
import rules.demonstrate.film
import rules.demonstrate.film_mujoco
import rules.demonstrate.film_stub
import rules.demonstrate.lerobot
import rules.demonstrate.lerobot_pyarrow
import rules.demonstrate.lerobot_stub
import rules.demonstrate.mcap
import rules.demonstrate.mcap_ros2
import rules.demonstrate.mcap_stub
import rules.demonstrate.operate
import rules.demonstrate.operate_mujoco
import rules.demonstrate.operate_stub
import rules.demonstrate.synthesize
import rules.demonstrate.synthesize_mujoco
import rules.demonstrate.synthesize_stub
import rules.evaluate.expert
import rules.evaluate.expert_mujoco
import rules.evaluate.expert_stub
import rules.evaluate.operator_trials
import rules.evaluate.operator_trials_mujoco
import rules.evaluate.operator_trials_stub
import rules.evaluate.overlay
import rules.evaluate.overlay_mujoco
import rules.evaluate.overlay_stub
import rules.evaluate.replay
import rules.evaluate.replay_mujoco
import rules.evaluate.replay_stub
import rules.evaluate.rollouts
import rules.evaluate.rollouts_mujoco
import rules.evaluate.rollouts_stub
import rules.evaluate.room
import rules.evaluate.room_mujoco
import rules.evaluate.room_stub
import rules.evaluate.views
import rules.evaluate.views_depth_splat
import rules.evaluate.views_gaussians
import rules.evaluate.views_mujoco
import rules.evaluate.views_one_sheet
import rules.evaluate.views_stub
import rules.factorize.contact.collision
import rules.factorize.contact.collision_coacd
import rules.factorize.contact.collision_stub
import rules.factorize.elements.parse
import rules.factorize.elements.parse_clusters
import rules.factorize.elements.parse_qwen3_vl
import rules.factorize.elements.parse_stub
import rules.factorize.elements.parse_vlm
import rules.factorize.elements.parse_written
import rules.factorize.joints.articulate
import rules.factorize.joints.articulate_crease
import rules.factorize.joints.articulate_particulate
import rules.factorize.joints.articulate_screw
import rules.factorize.joints.articulate_stub
import rules.factorize.masks.complete
import rules.factorize.masks.complete_flux2
import rules.factorize.masks.complete_mirrored
import rules.factorize.masks.complete_visible
import rules.factorize.masks.segment
import rules.factorize.masks.segment_depth
import rules.factorize.masks.segment_grabcut
import rules.factorize.masks.segment_sam3
import rules.factorize.masks.segment_stub
import rules.factorize.shapes.mesh
import rules.factorize.shapes.mesh_bounding_box
import rules.factorize.shapes.mesh_convex_hull
import rules.factorize.shapes.mesh_hunyuan3d_2_1
import rules.factorize.shapes.mesh_hunyuan3d_cloud
import rules.factorize.shapes.mesh_poisson
import rules.factorize.shapes.mesh_primitives
import rules.factorize.shapes.mesh_sam3d_objects
import rules.factorize.shapes.mesh_stub
import rules.factorize.shapes.mesh_trellis2
import rules.learn.act.act
import rules.learn.act.act_stub
import rules.learn.act.act_torch
import rules.learn.act.policy
import rules.learn.ppo.policy
import rules.learn.ppo.ppo
import rules.learn.ppo.ppo_sb3
import rules.learn.ppo.ppo_stub
import rules.reference.drawn.background_views
import rules.reference.drawn.background_views_mujoco
import rules.reference.drawn.background_views_stub
import rules.reference.drawn.draw
import rules.reference.drawn.draw_mujoco
import rules.reference.drawn.draw_stub
import rules.reference.drawn.place_robot_in_view
import rules.reference.drawn.place_robot_in_view_mujoco
import rules.reference.drawn.place_robot_in_view_stub
import rules.reference.photograph
import rules.reference.photograph_mujoco
import rules.reference.photograph_stub
import rules.reference.posed.postures
import rules.reference.posed.postures_mujoco
import rules.reference.posed.postures_stub
import rules.reference.posed.robot_views
import rules.reference.posed.robot_views_mujoco
import rules.reference.posed.robot_views_stub
import rules.reference.task
import rules.reference.task_mujoco
import rules.reference.task_stub
import rules.reference.truth
import rules.reference.truth_mujoco
import rules.reference.truth_stub
import rules.simulate.robots.mesh_robot
import rules.simulate.robots.mesh_robot_mujoco
import rules.simulate.robots.mesh_robot_stub
import rules.simulate.robots.published
import rules.simulate.robots.published_installed
import rules.simulate.robots.published_stub
import rules.simulate.task.task

align_follow_deaot: rules.align.follow.follow.FollowBackend = rules.align.follow.follow.follow_deaot
align_hand_eye_opencv: rules.align.calibration.hand_eye.HandEyeBackend = rules.align.calibration.hand_eye_opencv
align_hand_eye_stub: rules.align.calibration.hand_eye.HandEyeBackend = rules.align.calibration.hand_eye_stub
motion_opencv: rules.align.calibration.camera_motion.MotionBackend = rules.align.calibration.camera_motion_opencv
motion_stub: rules.align.calibration.camera_motion.MotionBackend = rules.align.calibration.camera_motion_stub
robot_camera_icp: rules.align.calibration.robot_camera.RefinementBackend = rules.align.calibration.robot_camera_icp
robot_camera_stub: rules.align.calibration.robot_camera.RefinementBackend = rules.align.calibration.robot_camera_stub
posed_mujoco: rules.reference.posed.robot_views.ViewsBackend = rules.reference.posed.robot_views_mujoco
posed_stub: rules.reference.posed.robot_views.ViewsBackend = rules.reference.posed.robot_views_stub
align_canonical_geometry: rules.align.canonical.canonical.CanonicalBackend = (
    rules.align.canonical.canonical.canonical_geometry
)
align_canonical_qwen3_vl: rules.align.canonical.canonical.CanonicalBackend = (
    rules.align.canonical.canonical.canonical_qwen3_vl
)
align_canonical_stub: rules.align.canonical.canonical.CanonicalBackend = rules.align.canonical.canonical.canonical_stub
align_follow_flow: rules.align.follow.follow.FollowBackend = rules.align.follow.follow.follow_flow
align_follow_sam3_video: rules.align.follow.follow.FollowBackend = rules.align.follow.follow.follow_sam3_video
align_follow_stub: rules.align.follow.follow.FollowBackend = rules.align.follow.follow.follow_stub
align_matches_disk_lightglue: rules.align.matches.matches.MatchesBackend = (
    rules.align.matches.matches.matches_disk_lightglue
)
align_matches_sift: rules.align.matches.matches.MatchesBackend = rules.align.matches.matches.matches_sift
align_matches_stub: rules.align.matches.matches.MatchesBackend = rules.align.matches.matches.matches_stub
align_matches_xfeat: rules.align.matches.matches.MatchesBackend = rules.align.matches.matches.matches_xfeat
align_object_bounding_box: rules.align.object.object.PlacementBackend = rules.align.object.object.object_bounding_box
align_object_icp: rules.align.object.object.PlacementBackend = rules.align.object.object.object_icp
align_object_open3d: rules.align.object.object.PlacementBackend = rules.align.object.object.object_open3d
align_object_stub: rules.align.object.object.PlacementBackend = rules.align.object.object.object_stub
align_track_foundation_pose: rules.align.track.track.TrackBackend = rules.align.track.track_foundation_pose
align_track_model: rules.align.track.track.TrackBackend = rules.align.track.track_model
align_track_stub: rules.align.track.track.TrackBackend = rules.align.track.track_stub
background_compose_gsplat: rules.background.room.compose.ComposeBackend = rules.background.room.compose_gsplat
background_compose_points: rules.background.room.compose.ComposeBackend = rules.background.room.compose_points
background_compose_warp: rules.background.room.compose.ComposeBackend = rules.background.room.compose_warp
background_compose_worldmirror: rules.background.room.compose.ComposeBackend = rules.background.room.compose_worldmirror
background_expand_stub: rules.background.room.expand.ExpandBackend = rules.background.room.expand_stub
background_expand_warp: rules.background.room.expand.ExpandBackend = rules.background.room.expand_warp
background_panorama_frustum: rules.background.room.panorama.PanoramaBackend = rules.background.room.panorama_frustum
background_panorama_hy_pano: rules.background.room.panorama.PanoramaBackend = rules.background.room.panorama_hy_pano
background_panorama_stub: rules.background.room.panorama.PanoramaBackend = rules.background.room.panorama_stub
background_paths_orbit: rules.background.room.paths.PathsBackend = rules.background.room.paths_orbit
background_robot_mujoco: rules.background.robot.RobotBackend = rules.background.robot_mujoco
background_robot_stub: rules.background.robot.RobotBackend = rules.background.robot_stub
background_static_flux2: rules.background.static.BackgroundBackend = rules.background.static_flux2
background_static_planes: rules.background.static.BackgroundBackend = rules.background.static_planes
background_static_stub: rules.background.static.BackgroundBackend = rules.background.static_stub
capture_reference_mujoco: rules.reference.photograph.CameraBackend = rules.reference.photograph_mujoco
capture_reference_stub: rules.reference.photograph.CameraBackend = rules.reference.photograph_stub
capture_truth_mujoco: rules.reference.truth.CameraBackend = rules.reference.truth_mujoco
capture_truth_stub: rules.reference.truth.CameraBackend = rules.reference.truth_stub
demonstrate_film_mujoco: rules.demonstrate.film.FilmBackend = rules.demonstrate.film_mujoco
demonstrate_film_stub: rules.demonstrate.film.FilmBackend = rules.demonstrate.film_stub
demonstrate_lerobot_pyarrow: rules.demonstrate.lerobot.LerobotBackend = rules.demonstrate.lerobot_pyarrow
demonstrate_lerobot_stub: rules.demonstrate.lerobot.LerobotBackend = rules.demonstrate.lerobot_stub
demonstrate_mcap_ros2: rules.demonstrate.mcap.McapBackend = rules.demonstrate.mcap_ros2
demonstrate_mcap_stub: rules.demonstrate.mcap.McapBackend = rules.demonstrate.mcap_stub
demonstrate_operate_mujoco: rules.demonstrate.operate.OperateBackend = rules.demonstrate.operate_mujoco
demonstrate_operate_stub: rules.demonstrate.operate.OperateBackend = rules.demonstrate.operate_stub
demonstrate_synthesize_mujoco: rules.demonstrate.synthesize.SynthesizeBackend = rules.demonstrate.synthesize_mujoco
demonstrate_synthesize_stub: rules.demonstrate.synthesize.SynthesizeBackend = rules.demonstrate.synthesize_stub
evaluate_operated_mujoco: rules.evaluate.operator_trials.OperatedBackend = rules.evaluate.operator_trials_mujoco
evaluate_operated_stub: rules.evaluate.operator_trials.OperatedBackend = rules.evaluate.operator_trials_stub
evaluate_overlay_mujoco: rules.evaluate.overlay.OverlayBackend = rules.evaluate.overlay_mujoco
evaluate_overlay_stub: rules.evaluate.overlay.OverlayBackend = rules.evaluate.overlay_stub
evaluate_replay_mujoco: rules.evaluate.replay.ReplayBackend = rules.evaluate.replay_mujoco
evaluate_replay_stub: rules.evaluate.replay.ReplayBackend = rules.evaluate.replay_stub
evaluate_rollouts_mujoco: rules.evaluate.rollouts.RolloutsBackend = rules.evaluate.rollouts_mujoco
evaluate_rollouts_stub: rules.evaluate.rollouts.RolloutsBackend = rules.evaluate.rollouts_stub
evaluate_room_mujoco: rules.evaluate.room.RoomBackend = rules.evaluate.room_mujoco
evaluate_room_stub: rules.evaluate.room.RoomBackend = rules.evaluate.room_stub
evaluate_views_depth_splat: rules.evaluate.views.ViewsBackend = rules.evaluate.views_depth_splat
evaluate_views_gaussians: rules.evaluate.views.ViewsBackend = rules.evaluate.views_gaussians
evaluate_views_mujoco: rules.evaluate.views.ViewsBackend = rules.evaluate.views_mujoco
evaluate_views_one_sheet: rules.evaluate.views.ViewsBackend = rules.evaluate.views_one_sheet
evaluate_views_stub: rules.evaluate.views.ViewsBackend = rules.evaluate.views_stub
crease: rules.factorize.joints.articulate.ArticulateBackend = rules.factorize.joints.articulate_crease
particulate: rules.factorize.joints.articulate.ArticulateBackend = rules.factorize.joints.articulate_particulate
screw: rules.factorize.joints.articulate.ArticulateBackend = rules.factorize.joints.articulate_screw
factorize_articulate_stub: rules.factorize.joints.articulate.ArticulateBackend = rules.factorize.joints.articulate_stub
factorize_collision_coacd: rules.factorize.contact.collision.CollisionBackend = rules.factorize.contact.collision_coacd
factorize_collision_stub: rules.factorize.contact.collision.CollisionBackend = rules.factorize.contact.collision_stub
factorize_complete_flux2: rules.factorize.masks.complete.CompleteBackend = rules.factorize.masks.complete_flux2
factorize_complete_mirrored: rules.factorize.masks.complete.CompleteBackend = rules.factorize.masks.complete_mirrored
factorize_complete_visible: rules.factorize.masks.complete.CompleteBackend = rules.factorize.masks.complete_visible
factorize_mesh_hunyuan3d_2_1: rules.factorize.shapes.mesh.MeshBackend = rules.factorize.shapes.mesh_hunyuan3d_2_1
factorize_mesh_hunyuan3d_cloud: rules.factorize.shapes.mesh.MeshBackend = rules.factorize.shapes.mesh_hunyuan3d_cloud
factorize_mesh_primitives: rules.factorize.shapes.mesh.MeshBackend = rules.factorize.shapes.mesh_primitives
factorize_mesh_sam3d_objects: rules.factorize.shapes.mesh.MeshBackend = rules.factorize.shapes.mesh_sam3d_objects
factorize_mesh_stub: rules.factorize.shapes.mesh.MeshBackend = rules.factorize.shapes.mesh_stub
factorize_mesh_trellis2: rules.factorize.shapes.mesh.MeshBackend = rules.factorize.shapes.mesh_trellis2
factorize_parse_clusters: rules.factorize.elements.parse.ParseBackend = rules.factorize.elements.parse_clusters
factorize_parse_qwen3_vl: rules.factorize.elements.parse.ParseBackend = rules.factorize.elements.parse_qwen3_vl
factorize_parse_stub: rules.factorize.elements.parse.ParseBackend = rules.factorize.elements.parse_stub
factorize_parse_vlm: rules.factorize.elements.parse.ParseBackend = rules.factorize.elements.parse_vlm
factorize_parse_written: rules.factorize.elements.parse.ParseBackend = rules.factorize.elements.parse_written
factorize_segment_depth: rules.factorize.masks.segment.SegmentBackend = rules.factorize.masks.segment_depth
factorize_segment_grabcut: rules.factorize.masks.segment.SegmentBackend = rules.factorize.masks.segment_grabcut
factorize_segment_sam3: rules.factorize.masks.segment.SegmentBackend = rules.factorize.masks.segment_sam3
factorize_segment_stub: rules.factorize.masks.segment.SegmentBackend = rules.factorize.masks.segment_stub
learn_act_stub: rules.learn.act.act.ActBackend = rules.learn.act.act_stub
learn_act_torch: rules.learn.act.act.ActBackend = rules.learn.act.act_torch
learn_act_policy: dextera_build.policy.running.Runner = rules.learn.act.policy
learn_ppo_policy: dextera_build.policy.running.Runner = rules.learn.ppo.policy
learn_ppo_sb3: rules.learn.ppo.ppo.PpoBackend = rules.learn.ppo.ppo_sb3
learn_ppo_stub: rules.learn.ppo.ppo.PpoBackend = rules.learn.ppo.ppo_stub
simulate_mesh_robot_mujoco: rules.simulate.robots.mesh_robot.MeshRobotBackend = rules.simulate.robots.mesh_robot_mujoco
simulate_mesh_robot_stub: rules.simulate.robots.mesh_robot.MeshRobotBackend = rules.simulate.robots.mesh_robot_stub
simulate_perturbed_mujoco: rules.simulate.task.task.perturbed.PerturbedBackend = (
    rules.simulate.task.task.perturbed_mujoco
)
simulate_perturbed_stub: rules.simulate.task.task.perturbed.PerturbedBackend = rules.simulate.task.task.perturbed_stub
simulate_published_installed: rules.simulate.robots.published.PublishedBackend = (
    rules.simulate.robots.published_installed
)
simulate_published_stub: rules.simulate.robots.published.PublishedBackend = rules.simulate.robots.published_stub
simulate_reference_mujoco: rules.reference.task.ReferenceBackend = rules.reference.task_mujoco
simulate_reference_stub: rules.reference.task.ReferenceBackend = rules.reference.task_stub
simulate_settle_mujoco: rules.simulate.scene.scene.settle.SettleBackend = rules.simulate.scene.scene.settle_mujoco
simulate_settle_stub: rules.simulate.scene.scene.settle.SettleBackend = rules.simulate.scene.scene.settle_stub
simulate_steady_mujoco: rules.simulate.scene.scene.steady.SteadyBackend = rules.simulate.scene.scene.steady_mujoco
simulate_steady_stub: rules.simulate.scene.scene.steady.SteadyBackend = rules.simulate.scene.scene.steady_stub
simulate_task_mujoco: rules.simulate.task.task.TaskBackend = rules.simulate.task.task.task_mujoco
simulate_task_stub: rules.simulate.task.task.TaskBackend = rules.simulate.task.task.task_stub
simulate_usd_openusd: rules.simulate.scene.usd.UsdBackend = rules.simulate.scene.scene.usd_openusd
simulate_usd_stub: rules.simulate.scene.usd.UsdBackend = rules.simulate.scene.scene.usd_stub
capture_draw_mujoco: rules.reference.drawn.draw.FallBackend = rules.reference.drawn.draw_mujoco
capture_emptied_mujoco: rules.reference.drawn.background_views.CameraBackend = (
    rules.reference.drawn.background_views_mujoco
)
capture_emptied_stub: rules.reference.drawn.background_views.CameraBackend = rules.reference.drawn.background_views_stub
capture_draw_stub: rules.reference.drawn.draw.FallBackend = rules.reference.drawn.draw_stub
capture_stand_mujoco: rules.reference.drawn.place_robot_in_view.StandBackend = (
    rules.reference.drawn.place_robot_in_view_mujoco
)
capture_stand_stub: rules.reference.drawn.place_robot_in_view.StandBackend = (
    rules.reference.drawn.place_robot_in_view_stub
)
capture_postures_mujoco: rules.reference.posed.postures.PosturesBackend = rules.reference.posed.postures_mujoco
capture_postures_stub: rules.reference.posed.postures.PosturesBackend = rules.reference.posed.postures_stub
bounding_box: rules.factorize.shapes.mesh.MeshBackend = rules.factorize.shapes.mesh_bounding_box
convex_hull: rules.factorize.shapes.mesh.MeshBackend = rules.factorize.shapes.mesh_convex_hull
poisson: rules.factorize.shapes.mesh.MeshBackend = rules.factorize.shapes.mesh_poisson
align_matches_superpoint: rules.align.matches.matches.MatchesBackend = (
    rules.align.matches.matches.matches_superpoint_lightglue
)
align_scene_sift: rules.align.scene.scene.SceneBackend = rules.align.scene.scene_sift
align_scene_stub: rules.align.scene.scene.SceneBackend = rules.align.scene.scene_stub
align_scene_superpoint: rules.align.scene.scene.SceneBackend = rules.align.scene.scene_superpoint_lightglue
evaluate_expert_mujoco: rules.evaluate.expert.ExpertBackend = rules.evaluate.expert_mujoco
evaluate_expert_stub: rules.evaluate.expert.ExpertBackend = rules.evaluate.expert_stub
