"""Reads the meshes of `colvis surface` with VTK and checks them against its stats.

    colvis surface SCAN --out m.ply --stats m.json   # and the same as .stl and .obj
    python tests/bench/surface.py m.json m.ply m.stl m.obj [--picture m.png]

Needs vtk and numpy (`pip install vtk numpy`). Fails if VTK finds an edge with one triangle or with more than two, a triangle
without area, or a volume, area or number of triangles, vertices or components that differs from the stats. --picture draws the
first mesh from four sides.
"""

import json
import sys

import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

READERS = {"ply": vtk.vtkPLYReader, "stl": vtk.vtkSTLReader, "obj": vtk.vtkOBJReader}


def read(path):
    """Reads a mesh and merges vertices at the same position."""
    reader = READERS[path.rsplit(".", 1)[1].lower()]()
    reader.SetFileName(path)
    reader.Update()
    joined = vtk.vtkCleanPolyData()
    joined.SetInputConnection(reader.GetOutputPort())
    joined.PointMergingOn()
    joined.ToleranceIsAbsoluteOn()
    joined.SetAbsoluteTolerance(0.0)
    joined.Update()
    return joined.GetOutput()


def edges(mesh, boundary, non_manifold):
    """Number of boundary or non-manifold edges."""
    found = vtk.vtkFeatureEdges()
    found.SetInputData(mesh)
    found.FeatureEdgesOff()
    found.ManifoldEdgesOff()
    found.SetBoundaryEdges(boundary)
    found.SetNonManifoldEdges(non_manifold)
    found.Update()
    return found.GetOutput().GetNumberOfCells()


def measure(mesh):
    """The mesh's properties to compare with the stats."""
    mass = vtk.vtkMassProperties()
    mass.SetInputData(mesh)
    mass.Update()
    corners = vtk_to_numpy(mesh.GetPoints().GetData()).astype(np.float64)
    faces = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    a, b, c = (corners[faces[:, n]] for n in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    signed = np.einsum("ij,ij->i", a - corners[0], np.cross(b - corners[0], c - corners[0])).sum() / 6000.0
    pieces = vtk.vtkPolyDataConnectivityFilter()
    pieces.SetInputData(mesh)
    pieces.SetExtractionModeToAllRegions()
    pieces.Update()
    return {
        "triangles": mesh.GetNumberOfPolys(),
        "vertices": mesh.GetNumberOfPoints(),
        "boundary_edges": edges(mesh, True, False),
        "non_manifold_edges": edges(mesh, False, True),
        "components": pieces.GetNumberOfExtractedRegions(),
        "area_mm2": mass.GetSurfaceArea(),
        "volume_ml": signed,
        "least_area_mm2": area.min(),
    }


def draw(mesh, path):
    """Draws the mesh from the front, the back, the left and from above."""
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetSize(1400, 1400)
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(mesh)
    views = [((0, -1, 0), (0, 0, 1)), ((0, 1, 0), (0, 0, 1)), ((1, 0, 0), (0, 0, 1)), ((0, 0, 1), (0, -1, 0))]
    for n, (from_side, up) in enumerate(views):
        actor = vtk.vtkActor()
        actor.SetMapper(mapper)
        actor.GetProperty().SetColor(0.85, 0.6, 0.5)
        back = vtk.vtkProperty()
        back.SetColor(0.1, 0.2, 0.9)
        actor.SetBackfaceProperty(back)
        renderer = vtk.vtkRenderer()
        renderer.SetViewport(0.5 * (n % 2), 0.5 * (n // 2), 0.5 * (n % 2) + 0.5, 0.5 * (n // 2) + 0.5)
        renderer.AddActor(actor)
        renderer.GetActiveCamera().SetPosition(*(1000.0 * x for x in from_side))
        renderer.GetActiveCamera().SetViewUp(*up)
        renderer.ResetCamera()
        window.AddRenderer(renderer)
    window.Render()
    picture = vtk.vtkWindowToImageFilter()
    picture.SetInput(window)
    writer = vtk.vtkPNGWriter()
    writer.SetInputConnection(picture.GetOutputPort())
    writer.SetFileName(path)
    writer.Write()


def main(args):
    picture = None
    if "--picture" in args:
        at = args.index("--picture")
        picture = args[at + 1]
        del args[at : at + 2]
    stats = json.load(open(args[0]))
    wrong = []
    for n, path in enumerate(args[1:]):
        mesh = read(path)
        seen = measure(mesh)
        print(path, json.dumps(seen))
        for name in ["triangles", "vertices", "components"]:
            if seen[name] != stats[name]:
                wrong.append(f"{path}: {name} {seen[name]}, expected {stats[name]}")
        for name in ["area_mm2", "volume_ml"]:
            if abs(seen[name] / stats[name] - 1.0) > 1e-5:
                wrong.append(f"{path}: {name} {seen[name]}, expected {stats[name]}")
        for name in ["boundary_edges", "non_manifold_edges"]:
            if seen[name] != 0:
                wrong.append(f"{path}: {seen[name]} {name}")
        if not seen["least_area_mm2"] > 0.0:
            wrong.append(f"{path}: a triangle without area")
        if n == 0 and picture:
            draw(mesh, picture)
    print("\n".join(wrong) if wrong else "all agree")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
