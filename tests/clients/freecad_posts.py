"""Runs inside FreeCAD (freecadcmd): a job with a profile, a pocket and five-axis moves, posted as by the button.

POSTS names a JSON file: a list of {"post", "arguments", "output", "gcode"}; `gcode` are the lines of the job's custom
operation. RESULTS is written with the text of the fault of each, or null.
"""

import json
import os
import sys
import traceback
from pathlib import Path

import FreeCAD
import Part
import PathScripts.PathPocketShape as PathPocket
from PathScripts import PathCustom, PathJob, PathPreferences, PathProfile
from PathScripts.PathPost import CommandPathPost


def main():
    posts = json.loads(Path(os.environ["POSTS"]).read_text())
    job, custom = block_with_pocket()
    results = [posted(job, custom, **each) for each in posts]
    Path(os.environ["RESULTS"]).write_text(json.dumps(results))


def block_with_pocket():
    """The job, and its custom operation."""
    document = FreeCAD.newDocument("sample")
    block = document.addObject("Part::Box", "Block")
    block.Length, block.Width, block.Height = 60, 40, 20
    hole = document.addObject("Part::Cylinder", "Hole")
    hole.Radius, hole.Height = 12, 8
    hole.Placement.Base = FreeCAD.Vector(30, 20, 12)
    part = document.addObject("Part::Cut", "Part")
    part.Base, part.Tool = block, hole
    document.recompute()
    job = PathJob.Create("Job", [part], None)
    tool = job.Tools.Group[0]
    tool.HorizFeed, tool.VertFeed, tool.SpindleSpeed, tool.SpindleDir = "600 mm/min", "200 mm/min", 8000, "Forward"
    document.recompute()
    model = job.Model.Group[0]
    floor = next(
        f"Face{n}"
        for n, face in enumerate(model.Shape.Faces, 1)
        if isinstance(face.Surface, Part.Plane) and abs(face.BoundBox.ZMax - 12) + abs(face.BoundBox.ZMin - 12) < 1e-6
    )
    profile, pocket = PathProfile.Create("Profile"), PathPocket.Create("Pocket")
    pocket.Base = [(model, floor)]
    for operation, step in ((profile, 10), (pocket, 4)):
        operation.setExpression("StepDown", None)
        operation.StepDown = step
    return job, PathCustom.Create("Custom")


def posted(job, custom, post, arguments, output, gcode):
    """Post the job; the fault, or None."""
    custom.Gcode = gcode
    FreeCAD.ActiveDocument.recompute()
    job.PostProcessor, job.PostProcessorArgs, job.PostProcessorOutputFile = post, arguments, output
    PathPreferences.setOutputFileDefaults(output, "Overwrite existing file")  # the default opens a dialog
    command = CommandPathPost()
    try:
        for objects in command.buildPostList(job):
            failed, _, _ = command.exportObjectsWith(objects, job)
            if failed:
                return "FreeCAD did not post"
    except Exception as fault:
        return str(fault)
    return None


status = 1
try:
    main()
    status = 0
except BaseException:
    traceback.print_exc()
sys.stdout.flush()
sys.stderr.flush()
os._exit(status)
