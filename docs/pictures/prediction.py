#!/usr/bin/python3
"""Draws docs/pictures/prediction.png: what `servotwin predict` says of data the fit has not seen.

    columns="X.command=qg[m],X.actual=qm[m],X.torque=vir[V]"
    build/servotwin identify DATA_EMPS.mat --columns "$columns" --axis X --training-share 0.5 --method joint --model x.json
    build/servotwin predict  DATA_EMPS.mat --columns "$columns" --axis X --model x.json --out x.csv
    docs/pictures/prediction.py x.csv x.json docs/pictures/prediction.png
"""
import csv
import json
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

table, model, out = sys.argv[1:]
unseen_from = json.load(open(model))["data"]["training_to"]
with open(table) as f:
    lines = [line for line in f if not line.startswith("#")]
columns = list(zip(*[[float(v or "nan") for v in row] for row in csv.reader(lines[1:])]))
names = next(csv.reader(lines[:1]))
data = dict(zip(names, columns))

first = next(i for i, t in enumerate(data["time[s]"]) if t >= unseen_from + 0.5)
last = next(i for i, t in enumerate(data["time[s]"]) if t >= unseen_from + 5.5)
time = data["time[s]"][first:last]
measured = [1e3 * v for v in data["X.measured_error[m]"][first:last]]
predicted = [1e3 * v for v in data["X.predicted_error[m]"][first:last]]
left = [1e6 * v for v in data["X.residual[m]"][first:last]]

figure, (above, below) = plt.subplots(2, 1, figsize=(9, 4.6), sharex=True, height_ratios=[3, 2])
above.plot(time, measured, color="#b8b8b8", linewidth=4, label="measured (command minus encoder)")
above.plot(time, predicted, color="#0b5fa5", linewidth=1, label="predicted from the command alone")
above.set_ylabel("tracking error [mm]")
above.legend(loc="upper right", frameon=False, ncols=2)
above.set_ylim(min(measured) * 1.15, max(measured) * 1.5)
below.plot(time, left, color="#a5330b", linewidth=0.8)
below.set_ylabel("measured minus\npredicted [µm]")
below.set_xlabel("time [s], after the data the model was fitted to")
for axes in (above, below):
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#eeeeee")
figure.tight_layout()
figure.savefig(out, dpi=110)
