% octave-cli several_axes.m FIT.mat FIT.json RECORDING.csv: the matrices of `servotwin multivariable` stepped along a
% recording leave of every error what the program says of its hold-out.
arguments = argv();
m = load(arguments{1});
fit = jsondecode(fileread(arguments{2}));
f = fopen(arguments{3});
skipped = 1;
while (line = fgetl(f))(1) == "#" skipped += 1; end
fclose(f);
header = strsplit(line, ",");
table = dlmread(arguments{3}, ",", skipped, 0);
column = @(axis, what) 1e-3 * table(:, strcmp(header, [axis, ".", what, "[mm]"]));
h = m.sample_time_s;
n = rows(table);
nA = columns(m.A);
nU = columns(m.B);

% The spline through samples, with end slopes of the cubics through its first and last four.
slope = @(x) [-11, 18, -9, 2] * x / (6 * h);
function [value, first, second] = pieces_of(x, h, slope)
  n = numel(x);
  p = spline(h * (0:n - 1), [slope(x(1:4)); x; -slope(x(n:-1:n - 3))]');
  value = [p.coefs(:, 4); x(n)];
  first = [p.coefs(:, 3); 0];
  second = [2 * p.coefs(:, 2); 0];
end

% Of every input its value and two derivatives at the start of every cycle.
u = zeros(3 * nU, n);
for i = 1:nU
  axis = strtok(m.inputs{i}, ".");
  if m.break_distances(i) > 0
    x = column(axis, "actual");
    force = zeros(n, 1);
    for k = 2:n
      force(k) = max(-1, min(1, force(k - 1) + (x(k) - x(k - 1)) / m.break_distances(i)));
    end
    u(3 * i - 2, :) = force;
    u(3 * i - 1, 1:n - 1) = diff(force) / h;
  else
    [~, velocity] = pieces_of(column(axis, "command"), h, slope);
    velocity(n) = velocity(n - 1);
    [u(3 * i - 2, :), u(3 * i - 1, :), u(3 * i, :)] = pieces_of(velocity, h, slope);
  end
end

augmented = zeros(nA + 3 * nU);
augmented(1:nA, 1:nA) = m.A;
for i = 1:nU
  at = nA + 3 * i - 2;
  augmented(1:nA, at) = m.B(:, i);
  augmented(at, at + 1) = augmented(at + 1, at + 2) = 1;
end
exact = expm(augmented * h);
phi = exact(1:nA, 1:nA);
gamma = exact(1:nA, nA + 1:end);
state = zeros(nA, 1);
y = zeros(rows(m.C), n);
for k = 1:n
  y(:, k) = m.C * state + m.D * u(1:3:end, k);
  state = phi * state + gamma * u(:, k);
end

held = ceil(0.7 * n):n;
for j = 1:rows(m.C)
  axis = strtok(m.outputs{j}, ".");
  left = column(axis, "command") - column(axis, "actual") - y(j, :)';
  left = std(left(held), 1);
  said = fit.outputs(j).holdout_rms;
  printf("%s: Octave leaves %.4g of %.4g m, the program says %.4g\n", m.outputs{j}, left, fit.outputs(j).rms, said);
  if !(abs(left - said) < 0.02 * said && said < 0.05 * fit.outputs(j).rms)
    error("the matrices are not the fit");
  end
end
if any(real(eig(m.A)) >= 0) error("the matrices are not stable"); end
