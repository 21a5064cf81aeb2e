#!/usr/bin/env python3
"""What `servotwin identify` says of recordings as their owners have them: BUILD DATA [PART_OF_A_NAME..]

Reads every recording below DATA with no option but --axis, where the program asks for one, and prints a table: file,
format, rows, rate, what was said first, seconds. Whether that is the right answer only a reader can tell."""
import pathlib
import re
import subprocess
import sys
import tempfile
import time

RECORDINGS = {".csv", ".tsv", ".txt", ".log", ".sco", ".mat", ".mcap", ".asc", ".trc", ".json", ".xml"}
NO_RECORDINGS = {"SOURCES.txt"}
LONGEST_S = 600  # for one recording; the slowest of ours takes 5 s


def is_recording(file):
    """By its suffix: mappings (.dbc, .eds, .dcf, .toml), texts and licences are none."""
    return file.suffix.lower() in RECORDINGS and file.name not in NO_RECORDINGS


def run(servotwin, words, folder):
    try:
        done = subprocess.run([servotwin, *words], cwd=folder, capture_output=True, text=True, errors="replace", check=False, timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        return f"servotwin {words[0]}: not done in {LONGEST_S} s"
    return done.stderr + done.stdout


def identify(servotwin, file, folder, options=()):
    return run(servotwin, ["identify", file, *options, "--model", "model.json"], folder)


def first_axis(output):
    """The axis to ask for, where the program names several."""
    found = re.search(r"has the axes ([^,\n]+),.*--axis", output)
    return found and found[1].strip()


def format_of(servotwin, file, folder):
    """The format that the program finds: what it names when another is asked for, else the one that it does not refuse."""
    nothing = ["--from", "1e9"]  # only the header is read
    found = re.search("looks like '(.*?)'", identify(servotwin, file, folder, ["--format", "mcap", *nothing]))
    if found:
        return found[1]
    for name in ("twincat", "tncscope", "halscope"):
        if f"--format {name}" not in identify(servotwin, file, folder, ["--format", name, *nothing]):
            return name
    return "table"


def said(output, file):
    """The error or the verdict, then the notes; of a table with foreign columns only what is proposed."""
    lines = [" ".join(line.split()).replace(f"{file}: ", "") for line in output.splitlines()]
    error = [re.sub("^servotwin [a-z]+: ", "refused: ", line) for line in lines if re.match("servotwin [a-z]+:", line)]
    first = error or [line for line in lines if line.startswith(("verdict", "The torque of", "No known cause"))]
    notes = [line for line in lines if line.startswith(("note:", "warning:")) and "ignored columns" not in line]
    text = re.sub(r"no column is named .*(--columns .*?)\. The file has.*", r"asks for \1", " / ".join(first + notes))
    return text.replace("|", "\\|")


def main():
    servotwin = pathlib.Path(sys.argv[1]).resolve() / "servotwin"
    data = pathlib.Path(sys.argv[2]).resolve()
    print("| file | format | rows | rate | said | s |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for file in sorted(filter(is_recording, data.rglob("*"))):
            if sys.argv[3:] and not any(part in str(file) for part in sys.argv[3:]):
                continue
            begin = time.monotonic()
            output = identify(servotwin, file, folder)
            axis = first_axis(output)
            if axis:
                output = identify(servotwin, file, folder, ["--axis", axis])
            chosen = ["--axis", axis] if axis else []
            if "explained by 'servotwin diagnose'" in output:  # position and torque without a command
                output = run(servotwin, ["diagnose", file, *chosen, "--to", "60"], folder)
            read = re.search(r"^axis .*?: (\d+) rows .*\((\S+ Hz)\)", output, re.MULTILINE)
            rows, rate = read.groups() if read else ("", "")
            name = str(file.relative_to(data)) + (f" `--axis {axis}`" if axis else "")
            seconds = time.monotonic() - begin
            print(f"| {name} | {format_of(servotwin, file, folder)} | {rows} | {rate} | {said(output, file)} | {seconds:.1f} |", flush=True)


if __name__ == "__main__":
    main()
