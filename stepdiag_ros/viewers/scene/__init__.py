"""What RViz, Foxglove and pages show: frames, measured lines, the deformed volume. No ROS here.

Frames (REP-103: right-handed, m, rad):

| frame | parent | what it is | published |
|---|---|---|---|
| `machine` | | machine coordinates X, Y, Z; rests with the workpiece | |
| `workpiece` | `machine` | parallel, at the measured box's first corner | `/tf_static`: a run |
| `tool` | `machine` | parallel, at the actual position of the axes | `/tf`: `joint_states` |
| `mirror` | `tool` | x: the mirror's normal, along the beam | `/tf_static`: a setup |
| `laser` | `machine` | before the first stop; x: the beam | `/tf_static`: a setup |

Whatever a machine really moves, `tool` is the tool relative to the workpiece: on a machine whose
table carries the workpiece along X, `tool` moves by +X where the table moves by -X. All of it is
nominal: what the measurement finds is a thousand times smaller and shown by markers, exaggerated.
Where the laser stands on the beam is known to no one but the operator; the distance is a parameter.

`header.frame_id` of the messages: `laser` for readings and for the air that the beam goes through,
`machine` for everything else. Bags from before had the names `interferometer` and `weather` there;
nothing reads them. The scene's parameter `frame_prefix`, for several cells that share `/tf`, is put
before the names in transforms and markers. Data keep the plain names: the namespace of their topic
says which cell they are of.
"""
