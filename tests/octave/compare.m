% octave-cli compare.m LOOP.mat SIM.csv: the matrices of `servotwin export` stepped along the commands of
% `servotwin simulate`, whose table has time, command and position.
arguments = argv();
m = load(arguments{1});
table = dlmread(arguments{2}, ",", 1, 0);
command = table(:, 2);
h = m.sample_time_s;
n = rows(command);

% The discretised matrices are the matrix exponential of the continuous ones with the inputs' integrators.
augmented = zeros(columns(m.A) + 5);
nA = columns(m.A);
augmented(1:nA, 1:nA) = m.A;
augmented(1:nA, nA + 1) = m.B(:, 1);
augmented(1:nA, nA + 4) = m.B(:, 2);
augmented(nA + 1, nA + 2) = augmented(nA + 2, nA + 3) = augmented(nA + 4, nA + 5) = 1;
exact = expm(augmented * h);
scale = max(abs([m.Phi, m.Gamma]), [], 2);
discretised = max(max(abs([m.Phi, m.Gamma] - exact(1:nA, :)) ./ scale));

% The command's spline, with end slopes of the cubics through its first and last four samples.
slope = @(x) [-11, 18, -9, 2] * x / (6 * h);
pieces = spline(h * (0:n - 1), [slope(command(1:4)); command; -slope(command(n:-1:n - 3))]');
c = pieces.coefs;
inputs = [c(:, 3), 2 * c(:, 2), 6 * c(:, 1), zeros(n - 1, 2)]';
state = zeros(nA, 1);
state(nA) = command(1);
out = zeros(3, n);
out(:, 1) = m.C * state + m.D(:, 1) * c(1, 3);
for k = 1:n - 1
  state = m.Phi * state + m.Gamma * inputs(:, k);
  out(:, k + 1) = m.C * state;
end
simulated = command - table(:, 3);
stepped = max(abs(out(1, :)' - simulated)) / max(abs(simulated));

printf("order %d: %d steps, error up to %.4g m; Octave less simulate %.2g of it; expm less Phi, Gamma %.2g\n", ...
       nA - 1, n - 1, max(abs(simulated)), stepped, discretised);
if !(stepped < 1e-9 && discretised < 1e-9 && max(abs(simulated)) > 1e-4 ...
     && strcmp(m.outputs{1}, "tracking_error [m]") && rows(m.states) == nA)
  error("the matrices are not what servotwin simulates");
end
