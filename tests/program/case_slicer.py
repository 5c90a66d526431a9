"""3D Slicer reads the findings, the centerline and the segments of a report: `case_slicer.py REPORT/`. Prints `ok`."""

import json
import sys
from pathlib import Path

import numpy as np
import slicer

report = Path(sys.argv[1])
told = json.loads((report / "findings.json").read_text())
scene = slicer.vtkMRMLScene()


def markups(name):
    """Returns the nodes of a file of markups, by their names, with their points in RAS."""
    storage = slicer.vtkMRMLMarkupsJsonStorageNode()
    scene.AddNode(storage)
    storage.SetFileName(str(report / name))
    nodes = {}
    for n in range(len(json.loads((report / name).read_text())["markups"])):
        node = storage.AddNewMarkupsNodeFromFile(str(report / name), None, n)
        assert node, (name, n)
        points = [node.GetNthControlPointPosition(k) for k in range(node.GetNumberOfControlPoints())]
        nodes[node.GetName()] = (node, np.array(points).reshape(-1, 3))
    return nodes


def to_ras(points):
    return np.reshape(points, (-1, 3)) * [-1, -1, 1]


nodes = markups("findings.mrk.json")
node, points = nodes["findings"]
assert np.abs(points - to_ras([f["place"] for f in told["findings"]])).max() < 0.01
assert node.GetNthControlPointLabel(0).startswith(told["findings"][0]["id"])
for finding in told["findings"]:
    if finding.get("ends"):
        line, ends = nodes[f"finding {finding['id']} diameter"]
        assert line.IsA("vtkMRMLMarkupsLineNode") and np.abs(ends - to_ras(finding["ends"])).max() < 0.01
[(curve, points)] = markups("centerline.mrk.json").values()
assert curve.IsA("vtkMRMLMarkupsCurveNode") and len(points) > 300
written = json.loads((report / "centerline.mrk.json").read_text())["markups"][0]["controlPoints"]
assert np.abs(points - to_ras([p["position"] for p in written])).max() < 0.01

node = slicer.vtkMRMLSegmentationNode()
scene.AddNode(node)
storage = slicer.vtkMRMLSegmentationStorageNode()
scene.AddNode(storage)
storage.SetFileName(str(report / "lumen.seg.nrrd"))
assert storage.ReadData(node) == 1
segmentation = node.GetSegmentation()
names = [segmentation.GetNthSegment(n).GetName() for n in range(segmentation.GetNumberOfSegments())]
assert names[0] == "rectum" and names[7] == "cecum", names
assert len({segmentation.GetNthSegment(n).GetColor() for n in range(8)}) == 8
print("ok")
